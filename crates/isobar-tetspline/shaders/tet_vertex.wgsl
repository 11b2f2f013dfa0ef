// K11, K12, the vertex stage (Kalbe et al. 2009, section 4.3): a generic tetrahedron as a triangle strip of six vertices, moved to its cube; its coefficients, flat over the
// tetrahedron; and, for interpolated rays, the barycentric coordinates of the vertex and of a point one unit behind it, seen from the eye.
// The paper has 24 programs, one for each kind; in canonical coordinates they are one, and a kind is a signed permutation of axes.

@group(0) @binding(4) var<storage, read> tetrahedra: array<u32>;
@group(0) @binding(5) var<storage, read> bases: array<u32>;

// Centre of the inscribed sphere, in canonical coordinates; its radius is 0.1306.
const INCENTRE: vec3<f32> = vec3(0.36939806, 0.18469903, 0.0);

fn corner(n: u32, flip: f32) -> vec3<f32> {
    if n == 0u {
        return vec3(0.0);
    }
    if n == 1u {
        return vec3(0.5, 0.0, 0.0);
    }
    return vec3(0.5, 0.5, select(-0.5, 0.5, n == 2u) * flip);
}

fn clip_of(p: vec3<f32>) -> vec4<f32> {
    return view.clip_x * p.x + view.clip_y * p.y + view.clip_z * p.z + view.clip_offset;
}

@vertex
fn vs(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    let kind = vertex / 6u;
    let place = vertex % 6u;
    let axes = frame(kind);
    // Outward faces turn the same way for every kind.
    let flip = determinant(axes);
    let at = owner(tetrahedra[bases[kind] + instance]);
    let q = cube_of(at.x) - view.origin;
    let c = corner(place & 3u, flip);
    let middle = vec3<f32>(q);
    // The greatest w of the cube: as much as its pixels can be apart.
    let most = clip_of(middle).w + 0.5 * (abs(view.clip_x.w) + abs(view.clip_y.w) + abs(view.clip_z.w));
    let p = middle + axes * (c + (view.grow * max(most, 0.0)) * (c - INCENTRE));
    var out: Varying;
    out.position = clip_of(p);
    out.cube = vec4(q, i32(kind));
    // The first vertex of each of the four triangles of the strip speaks for it.
    if place < 4u {
        let b = patch_of(at, kind, axes);
        out.b0 = b.b0;
        out.b1 = b.b1;
        out.b2 = b.b2;
        out.b3 = b.b3;
        out.b4 = b.b4;
    }
    set_ray(&out, c, p, axes);
    return out;
}
