fn count_fragment(pixel: vec2<u32>) {}
