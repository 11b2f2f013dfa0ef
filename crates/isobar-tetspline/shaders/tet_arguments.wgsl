// Where the list of each kind begins in T_active, the number of all tetrahedra (bases[24]), and the 24 indirect draws: six vertices of a strip, as many instances as
// there are tetrahedra of the kind, the first vertex telling the kind.

@group(0) @binding(2) var<storage, read_write> bases: array<u32>;
@group(0) @binding(3) var<storage, read_write> draws: array<u32>;

@compute @workgroup_size(1)
fn main() {
    var sum = 0u;
    for (var kind = 0u; kind < 24u; kind++) {
        let count = bases[kind];
        bases[kind] = sum;
        let fits = min(count, params.room_tets - min(sum, params.room_tets));
        draws[4u * kind] = 6u;
        draws[4u * kind + 1u] = fits;
        draws[4u * kind + 2u] = 6u * kind;
        draws[4u * kind + 3u] = 0u;
        sum += count;
    }
    bases[24] = sum;
}
