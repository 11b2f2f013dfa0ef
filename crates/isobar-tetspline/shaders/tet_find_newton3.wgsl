// As printed: the second point lies one voxel behind the first, and of the three results the first counts whose barycentric coordinates are all positive (0 included).
fn find(b: Patch, span: Span, before: Before) -> Found {
    var out: Found;
    out.level = -1;
    let from_s = span.from_s;
    out.a = span.phi + from_s * span.step;
    out.b = out.a + UNIT * span.step;
    out.qa = first_step(b, out.a);
    out.qb = first_step(b, out.b);
    let la = second_step(out.qa, out.a);
    let lb = second_step(out.qb, out.b);
    let cubic = vec4(dot(la, out.a), dot(la, out.b), dot(lb, out.a), dot(lb, out.b));
    var best = FAR;
    for (var j = 0u; j < params.levels; j++) {
        let m = monomial(cubic - levels[j].value);
        let t = newton_sequences(m);
        for (var n = 0; n < 3; n++) {
            let x = t[n];
            let s = from_s + UNIT * x;
            let phi = mix(out.a, out.b, x);
            let past = before.sense == 0 || s > before.s;
            if x >= 0.0 && x < best && s <= span.to_s && past && all(phi >= vec4(0.0)) {
                best = x;
                out.level = i32(j);
                out.rises = m.y + x * (2.0 * m.z + 3.0 * x * m.w) >= 0.0;
            }
        }
    }
    out.x = best;
    out.s = from_s + UNIT * best;
    return out;
}
