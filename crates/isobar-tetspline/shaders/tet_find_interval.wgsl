// The first root between the ends of the span: b30, b21, b12, b03 by 10 + 10, 4 + 4 and 4 inner products.
fn find(b: Patch, span: Span, before: Before) -> Found {
    var out: Found;
    out.level = -1;
    let from_s = select(span.from_s, max(span.from_s, before.s), before.sense != 0);
    out.a = span.phi + from_s * span.step;
    out.b = span.phi + span.to_s * span.step;
    out.qa = first_step(b, out.a);
    out.qb = first_step(b, out.b);
    let la = second_step(out.qa, out.a);
    let lb = second_step(out.qb, out.b);
    let cubic = vec4(dot(la, out.a), dot(la, out.b), dot(lb, out.a), dot(lb, out.b));
    var best = NO_ROOT;
    if from_s <= span.to_s {
        for (var j = 0u; j < params.levels; j++) {
            let c = cubic - levels[j].value;
            // A surface is left by the side that it was not entered by.
            let wanted = select(0, -before.sense, levels[j].surface == before.surface);
            let x = first_root(c, wanted);
            if x < best {
                best = x;
                out.level = i32(j);
                let d = slopes(c);
                let p = mix(d.xy, d.yz, x);
                out.rises = mix(p.x, p.y, x) >= 0.0;
            }
        }
    }
    out.x = best;
    out.s = from_s + best * (span.to_s - from_s);
    return out;
}
