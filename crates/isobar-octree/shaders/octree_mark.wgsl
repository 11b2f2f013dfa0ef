// The cells of each active brick that may meet an isovalue: one workgroup per brick, one invocation per cell.

@group(0) @binding(2) var<storage, read> active_bricks: array<u32>;
@group(0) @binding(3) var<storage, read> levels: array<Level>;
@group(0) @binding(4) var<storage, read_write> cells: array<vec2<u32>>;

// Cells are taken to meet an isovalue within this much of their largest |coefficient - bias|: what a ray that leaves a brick by its
// rounded face may see beyond it.
const SLACK: f32 = 6.1035e-5;

var<workgroup> found: array<atomic<u32>, 2>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let slot = group.y * groups.x + group.x;
    if slot < params.bricks {
        let n = (params.cells + 3u) / 4u;
        let i = active_bricks[slot];
        let b = vec3(i % n.x, i / n.x % n.y, i / (n.x * n.y));
        let c = b * 4u + vec3(local & 3u, local >> 2u & 3u, local >> 4u);
        if all(c < params.cells) {
            let lo = max(vec3<i32>(c) + BEFORE, vec3(0));
            let hi = min(vec3<i32>(c) + BEFORE + DEGREE, params.last);
            let first = coefficient(lo);
            var range = vec2(first, first);
            for (var z = lo.z; z <= hi.z; z++) {
                for (var y = lo.y; y <= hi.y; y++) {
                    for (var x = lo.x; x <= hi.x; x++) {
                        let v = coefficient(vec3(x, y, z));
                        range = vec2(min(range.x, v), max(range.y, v));
                    }
                }
            }
            let slack = SLACK * max(abs(range.x), abs(range.y));
            var meets = false;
            for (var j = 0u; j < params.levels; j++) {
                let v = levels[j].value;
                meets = meets || (range.x - slack <= v && v <= range.y + slack);
            }
            if meets {
                atomicOr(&found[local >> 5u], 1u << (local & 31u));
            }
        }
    }
    workgroupBarrier();
    if local == 0u && slot < params.bricks {
        cells[slot] = vec2(atomicLoad(&found[0]), atomicLoad(&found[1]));
    }
}
