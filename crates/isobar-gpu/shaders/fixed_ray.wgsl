// A ray in fixed point: entry = cell + fraction * 2^-32, and per half voxel +-(direction * 2^-32 + ten bits of `fine` * 2^-42). The twin of
// isobar_gpu::rays::FixedRay.
struct FixedRay {
    cell: vec3<u32>,
    // bits 0 to 15: whole half voxels from entry to exit; 16 to 18: the axes along which it falls; 31: it misses the domain
    length: u32,
    fraction: vec3<u32>,
    // the rest of the length, below 1
    rest: f32,
    direction: vec3<u32>,
    fine: u32,
}

const FIXED_UNIT: f32 = 2.3283064365386963e-10;

fn fixed_falls(ray: FixedRay) -> vec3<bool> {
    return vec3((ray.length & 0x10000u) != 0u, (ray.length & 0x20000u) != 0u, (ray.length & 0x40000u) != 0u);
}

// Direction per half voxel.
fn fixed_direction(ray: FixedRay) -> vec3<f32> {
    let size = vec3<f32>(ray.direction) * FIXED_UNIT;
    return select(size, -size, fixed_falls(ray));
}

// The ray's point `whole` half voxels (below 2^16) behind its entry, less `centre`, along one axis.
fn fixed_axis(cell: u32, fraction: u32, direction: u32, tail: u32, falls: bool, whole: u32, centre: i32) -> f32 {
    // whole * (direction * 2^-32 + tail * 2^-42) in whole cells and 2^-32
    let a = whole * (direction >> 16u);
    let b = whole * (direction & 0xffffu);
    let low = b + ((whole * tail) >> 10u);
    let low_carry = select(0u, 1u, low < b);
    let part = (a << 16u) + low;
    let part_carry = select(0u, 1u, part < low);
    let on = (a >> 16u) + low_carry + part_carry;
    if falls {
        let borrow = select(0, 1, fraction < part);
        return f32(i32(cell) - i32(on) - borrow - centre) + f32(fraction - part) * FIXED_UNIT;
    }
    let f = fraction + part;
    let over_one = select(0, 1, f < part);
    return f32(i32(cell) + i32(on) + over_one - centre) + f32(f) * FIXED_UNIT;
}

// The point `whole` half voxels behind the entry, less `centre`.
fn fixed_point(ray: FixedRay, whole: u32, centre: vec3<i32>) -> vec3<f32> {
    let falls = fixed_falls(ray);
    return vec3(
        fixed_axis(ray.cell.x, ray.fraction.x, ray.direction.x, ray.fine & 1023u, falls.x, whole, centre.x),
        fixed_axis(ray.cell.y, ray.fraction.y, ray.direction.y, ray.fine >> 10u & 1023u, falls.y, whole, centre.y),
        fixed_axis(ray.cell.z, ray.fraction.z, ray.direction.z, ray.fine >> 20u & 1023u, falls.z, whole, centre.z),
    );
}
