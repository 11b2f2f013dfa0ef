// K20, K21: the texture and the curves of src/paint.rs at the exact hit, in f32. Bits 0 to 15: the brightness, times 65535; bit 16: on a curve.

const TAU: f32 = 6.2831853;
const VEINS: f32 = 5.0;
const BENT: f32 = 1.2;
const DARK: f32 = 0.25;

// Bits of view.paint.
const MARBLE: u32 = 1u;
const CURVES: u32 = 2u;

fn slope_at(cell: vec3<i32>) -> vec3<f32> {
    let c = bitcast<vec3<u32>>(cell);
    var h = (0x9e3779b9u ^ c.x) * 0x85ebca6bu;
    h ^= h >> 13u;
    h = (h ^ c.y) * 0x85ebca6bu;
    h ^= h >> 13u;
    h = (h ^ c.z) * 0x85ebca6bu;
    h ^= h >> 13u;
    h *= 0xc2b2ae35u;
    h ^= h >> 16u;
    let u = 1.0 - 2.0 * f32(h >> 24u & 1u);
    let v = 1.0 - 2.0 * f32(h >> 25u & 1u);
    let kind = (h & 0xffffffu) % 3u;
    return select(select(vec3(u, v, 0.0), vec3(u, 0.0, v), kind == 1u), vec3(0.0, u, v), kind == 0u);
}

fn noise(p: vec3<f32>) -> f32 {
    let base = floor(p);
    let f = p - base;
    let fade = f * f * (3.0 - 2.0 * f);
    let cell = vec3<i32>(base);
    var sum = 0.0;
    for (var corner = 0; corner < 8; corner++) {
        let o = vec3(corner, corner >> 1u, corner >> 2u) & vec3(1);
        let w = select(1.0 - fade, fade, o == vec3(1));
        sum += w.x * w.y * w.z * dot(slope_at(cell + o), f - vec3<f32>(o));
    }
    return sum;
}

fn paint_of(in: Varying, phi: vec4<f32>, axes: mat3x3<f32>, normal: vec3<f32>) -> u32 {
    // Where the hit lies about the middle of its cube.
    let local = axes * vec3(0.5 * (1.0 - phi.x), 0.5 * (phi.z + phi.w), 0.5 * (phi.z - phi.w));
    var bright = 1.0;
    if (view.paint & MARBLE) != 0u {
        let unit = (vec3<f32>(in.cube.xyz + view.origin) + local) * view.unit;
        var bent = 0.0;
        for (var octave = 0; octave < 4; octave++) {
            let scale = f32(1 << u32(octave));
            bent += noise(unit * (8.0 * scale)) / scale;
        }
        let vein = sin(TAU * VEINS * (unit.x + unit.z) * 0.5 + BENT * TAU * bent);
        bright = DARK + (1.0 - DARK) * sqrt(max(0.5 + 0.5 * vein, 0.0));
    }
    var curve = false;
    if (view.paint & CURVES) != 0u {
        let p = vec3<f32>(in.cube.xyz) + local;
        let far = select(length(view.axes * (p - view.eye)), 1.0, view.parallel == 1u);
        // Faces of cubes lie half a voxel from their middle.
        let away = abs(0.5 - abs(local));
        for (var a = 0; a < 3; a++) {
            let across = view.gradients[a];
            let slope = length(across - dot(across, normal) * normal);
            curve = curve || away[a] < view.reach * far * slope;
        }
    }
    return u32(round(clamp(bright, 0.0, 1.0) * 65535.0)) | select(0u, 0x10000u, curve);
}
