// Fragments per pixel: the overdraw.
@group(0) @binding(11) var<storage, read_write> work: array<atomic<u32>>;

fn count_fragment(pixel: vec2<u32>) {
    atomicAdd(&work[pixel.y * view.width + pixel.x], 1u);
}
