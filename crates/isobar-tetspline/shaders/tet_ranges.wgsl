// K27, the min/max hierarchy: least and greatest of the 27 data of 256 cubes that follow each other, once per data set (the bias is 0 here).

@group(0) @binding(3) var<storage, read_write> ranges: array<vec2<f32>>;

var<workgroup> least: array<f32, 256>;
var<workgroup> greatest: array<f32, 256>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group.y * ROW + group.x;
    let i = min(block * 256u + local, params.count - 1u);
    let hull = data_hull(cube_of(i));
    least[local] = hull.x;
    greatest[local] = hull.y;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if local < step {
            least[local] = min(least[local], least[local + step]);
            greatest[local] = max(greatest[local], greatest[local + step]);
        }
        workgroupBarrier();
    }
    if local == 0u && block * 256u < params.count {
        ranges[block] = vec2(least[0], greatest[0]);
    }
}
