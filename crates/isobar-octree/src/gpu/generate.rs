//! WGSL of the polynomial of a cell: composition with the ray, evaluation, subdivision, gradient; generated for the degree of the spline.
//!
//! Steinberger 2010, section 3.5 (static control flow, inventory S19): on a GPU an array that is indexed by a loop counter lives in memory and
//! not in registers, so the loops are written out: every coefficient is a name of its own. [`Loops::Looped`] keeps the loops and the arrays, for
//! comparison; both do the same operations in the same order.
//!
//! The composition is the separable one in scaled Bernstein form (section 3.2.3): along each axis the basis functions restricted to the ray's
//! segment in the cell are polynomials whose Bernstein coefficients are values of their polar forms at the ends a and b, all of them at least
//! 0; products of scaled forms are convolutions; the binomials are divided out once, at the end.

use std::fmt::Write as _;

/// Whether loops over coefficients are written out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Loops {
    /// Straight-line code.
    Unrolled,
    /// Loops over private arrays.
    Looped,
}

/// Binomial coefficients of `n`.
fn binomials(n: usize) -> Vec<u32> {
    let mut row = vec![1u32];
    for k in 1..=n {
        row.push(row[k - 1] * (n - k + 1) as u32 / k as u32);
    }
    row
}

/// `c_0 + c_1 + ...` of the terms `f(i)`.
fn sum(n: usize, f: impl Fn(usize) -> String) -> String {
    (0..n).map(f).collect::<Vec<_>>().join(" + ")
}

/// `1.0, 3.0, ...`
fn list(values: impl Iterator<Item = f64>) -> String {
    values.map(|v| format!("{v:?}")).collect::<Vec<_>>().join(", ")
}

/// The text for a spline of this degree per axis (1, 2 or 3).
pub(super) fn polynomial(degree: usize, loops: Loops) -> String {
    let before = if degree == 1 { 0 } else { -1 };
    let mut out = format!("const DEGREE: i32 = {degree};\nconst BEFORE: i32 = {before};\n");
    out += &axis(degree);
    out += &match loops {
        Loops::Unrolled => unrolled(degree),
        Loops::Looped => looped(degree),
    };
    out
}

/// The constants alone: what the kernels that build bricks need.
pub(super) fn constants(degree: usize) -> String {
    polynomial(degree, Loops::Unrolled)
        .lines()
        .take(2)
        .collect::<Vec<_>>()
        .join("\n")
        + "\n"
}

/// One axis: scaled Bernstein coefficients of the basis functions on [a, b] (`basis`, row j for basis function j), their values and slopes at x.
/// Indices of the stencil's coefficients.
fn axis(degree: usize) -> String {
    let (basis, weights, slopes) = match degree {
        1 => (
            "vec4(p, q, 0.0, 0.0), vec4(a, b, 0.0, 0.0), vec4(0.0), vec4(0.0)",
            "vec4(u, x, 0.0, 0.0)",
            "vec4(-1.0, 1.0, 0.0, 0.0)",
        ),
        2 => (
            "vec4(0.5 * p * p, p * q, 0.5 * q * q, 0.0), vec4(0.5 + a * p, 1.0 + (a * q + b * p), 0.5 + b * q, 0.0), \
             vec4(0.5 * a * a, a * b, 0.5 * b * b, 0.0), vec4(0.0)",
            "vec4(0.5 * u * u, 0.5 + x * u, 0.5 * x * x, 0.0)",
            "vec4(-u, 1.0 - 2.0 * x, x, 0.0)",
        ),
        _ => (
            "end3(p, q), inner3(a, b), inner3(p, q), end3(a, b)",
            "vec4(SIXTH * u * u * u, inner(x), inner(u), SIXTH * x * x * x)",
            "vec4(-0.5 * u * u, x * (1.5 * x - 2.0), u * (2.0 - 1.5 * u), 0.5 * x * x)",
        ),
    };
    let cubic = "\
const SIXTH: f32 = 1.0 / 6.0;
const TWO_THIRDS: f32 = 2.0 / 3.0;
fn inner(x: f32) -> f32 { return TWO_THIRDS + x * x * (0.5 * x - 1.0); }
fn end3(a: f32, b: f32) -> vec4<f32> {
    return vec4(SIXTH * a * a * a, 0.5 * a * a * b, 0.5 * a * b * b, SIXTH * b * b * b);
}
fn inner3(a: f32, b: f32) -> vec4<f32> {
    return vec4(inner(a), 2.0 - a * (a + 2.0 * b) + 1.5 * a * a * b, 2.0 - b * (2.0 * a + b) + 1.5 * a * b * b, inner(b));
}
";
    let indices = if degree == 1 {
        "vec4(i, i + 1, 0, 0)"
    } else {
        "vec4(inside(i - 1, last), inside(i, last), inside(i + 1, last), inside(i + 2, last))"
    };
    format!(
        "{cubic}\
struct Basis {{ j0: vec4<f32>, j1: vec4<f32>, j2: vec4<f32>, j3: vec4<f32> }}
fn basis(a: f32, b: f32) -> Basis {{
    let p = 1.0 - a;
    let q = 1.0 - b;
    return Basis({basis});
}}
fn weights(x: f32) -> vec4<f32> {{
    let u = 1.0 - x;
    return {weights};
}}
fn slopes(x: f32) -> vec4<f32> {{
    let u = 1.0 - x;
    return {slopes};
}}
fn indices(i: i32, last: i32) -> vec4<i32> {{
    return {indices};
}}
"
    )
}

/// Name of component `i` of a vector.
fn xyzw(i: usize) -> &'static str {
    ["x", "y", "z", "w"][i]
}

fn unrolled(degree: usize) -> String {
    let n = 3 * degree;
    let fields = |f: &dyn Fn(usize) -> String| (0..=n).map(f).collect::<Vec<_>>().join(", ");
    let mut out = format!("struct Poly {{ {} }}\n", fields(&|i| format!("c{i}: f32")));
    let _ = writeln!(out, "fn first_of(p: Poly) -> f32 {{ return p.c0; }}");
    let _ = writeln!(out, "fn last_of(p: Poly) -> f32 {{ return p.c{n}; }}");
    let rest = (1..=n).map(|i| format!("p.c{i}")).collect::<Vec<_>>().join(", ");
    let _ = writeln!(out, "fn with_first(p: Poly, x: f32) -> Poly {{ return Poly(x, {rest}); }}");
    let nested = |f: &str| (1..=n).fold("p.c0".to_owned(), |a, i| format!("{f}({a}, p.c{i})"));
    let _ = writeln!(
        out,
        "fn bounds(p: Poly) -> vec2<f32> {{ return vec2({}, {}); }}",
        nested("min"),
        nested("max")
    );
    let change = sum(n, |i| format!("select(0u, 1u, (p.c{i} < v) != (p.c{} < v))", i + 1));
    let _ = writeln!(out, "fn changes(p: Poly, v: f32) -> u32 {{ return {change}; }}");
    let all = |op: &str| {
        (0..n)
            .map(|i| format!("p.c{i} {op} p.c{}", i + 1))
            .collect::<Vec<_>>()
            .join(" && ")
    };
    let _ = writeln!(
        out,
        "fn is_monotone(p: Poly) -> bool {{ return ({}) || ({}); }}",
        all("<="),
        all(">=")
    );
    out += &unrolled_evaluate(n);
    out += &unrolled_part(n);
    out += &unrolled_compose(degree);
    out += &unrolled_gradient(degree);
    out
}

/// Value and derivative by Horner's rule in Bernstein form.
fn unrolled_evaluate(n: usize) -> String {
    let (b, e) = (binomials(n), binomials(n - 1));
    let mut out = "fn evaluate(p: Poly, x: f32) -> vec2<f32> {\n    let y = 1.0 - x;\n    var t = x;\n".to_owned();
    out += "    var f = p.c0;\n    var g = p.c1 - p.c0;\n";
    for i in 1..=n {
        let _ = writeln!(out, "    f = f * y + {:?} * p.c{i} * t;", f64::from(b[i]));
        if i < n {
            let _ = writeln!(out, "    g = g * y + {:?} * (p.c{} - p.c{i}) * t;", f64::from(e[i]), i + 1);
            out += "    t *= x;\n";
        }
    }
    let _ = writeln!(out, "    return vec2(f, {:?} * g);\n}}", n as f64);
    out
}

/// De Casteljau's rule twice: the part [0, hi], then [lo, hi] of it.
fn unrolled_part(n: usize) -> String {
    let mut out =
        "fn part_of(p: Poly, lo: f32, hi: f32) -> Poly {\n    let y = 1.0 - hi;\n    let v = lo / hi;\n    let u = 1.0 - v;\n"
            .to_owned();
    for i in 0..=n {
        let _ = writeln!(out, "    var c{i} = p.c{i};");
    }
    for r in 1..=n {
        for i in (r..=n).rev() {
            let _ = writeln!(out, "    c{i} = y * c{} + hi * c{i};", i - 1);
        }
    }
    for r in 1..=n {
        for i in 0..=n - r {
            let _ = writeln!(out, "    c{i} = u * c{i} + v * c{};", i + 1);
        }
    }
    let all = (0..=n).map(|i| format!("c{i}")).collect::<Vec<_>>().join(", ");
    let _ = writeln!(out, "    return Poly({all});\n}}");
    out
}

fn unrolled_compose(degree: usize) -> String {
    let n = 3 * degree;
    let mut out = "\
fn compose(cell: vec3<i32>, a: vec3<f32>, b: vec3<f32>) -> Poly {
    let bx = basis(a.x, b.x);
    let by = basis(a.y, b.y);
    let bz = basis(a.z, b.z);
    let ix = indices(cell.x, params.last.x);
    let iy = indices(cell.y, params.last.y);
    let iz = indices(cell.z, params.last.z);
"
    .to_owned();
    for i in 0..=n {
        let _ = writeln!(out, "    var c{i} = 0.0;");
    }
    for k in 0..=degree {
        out += "    {\n";
        for i in 0..=2 * degree {
            let _ = writeln!(out, "        var q{i} = 0.0;");
        }
        for j in 0..=degree {
            out += "        {\n";
            for i in 0..=degree {
                let (x, y, z) = (xyzw(i), xyzw(j), xyzw(k));
                let _ = writeln!(out, "            let s{i} = coefficient(vec3(ix.{x}, iy.{y}, iz.{z}));");
            }
            for m in 0..=degree {
                let row = sum(degree + 1, |i| format!("s{i} * bx.j{i}.{}", xyzw(m)));
                let _ = writeln!(out, "            let r{m} = {row};");
            }
            for m in 0..=degree {
                for i in 0..=degree {
                    let _ = writeln!(out, "            q{} += by.j{j}.{} * r{i};", m + i, xyzw(m));
                }
            }
            out += "        }\n";
        }
        for m in 0..=degree {
            for i in 0..=2 * degree {
                let _ = writeln!(out, "        c{} += bz.j{k}.{} * q{i};", m + i, xyzw(m));
            }
        }
        out += "    }\n";
    }
    let b = binomials(n);
    let all = (0..=n)
        .map(|i| format!("c{i} * {:?}", 1.0 / f64::from(b[i])))
        .collect::<Vec<_>>()
        .join(", ");
    let _ = writeln!(out, "    return Poly({all});\n}}");
    out
}

/// The part of `gradient` before its sums.
const GRADIENT: &str = "\
fn gradient(cell: vec3<i32>, at: vec3<f32>) -> vec3<f32> {
    var wx = weights(at.x);
    var wy = weights(at.y);
    var wz = weights(at.z);
    var dx = slopes(at.x);
    var dy = slopes(at.y);
    var dz = slopes(at.z);
    var ix = indices(cell.x, params.last.x);
    var iy = indices(cell.y, params.last.y);
    var iz = indices(cell.z, params.last.z);
    var g = vec3(0.0);
";

fn unrolled_gradient(degree: usize) -> String {
    let mut out = GRADIENT.to_owned();
    for k in 0..=degree {
        for j in 0..=degree {
            let (y, z) = (xyzw(j), xyzw(k));
            out += "    {\n";
            for i in 0..=degree {
                let x = xyzw(i);
                let _ = writeln!(out, "        let s{i} = coefficient(vec3(ix.{x}, iy.{y}, iz.{z}));");
            }
            let _ = writeln!(
                out,
                "        let v = {};",
                sum(degree + 1, |i| format!("s{i} * wx.{}", xyzw(i)))
            );
            let _ = writeln!(
                out,
                "        let d = {};",
                sum(degree + 1, |i| format!("s{i} * dx.{}", xyzw(i)))
            );
            let _ = writeln!(
                out,
                "        g += vec3(wz.{z} * wy.{y} * d, wz.{z} * dy.{y} * v, dz.{z} * wy.{y} * v);"
            );
            out += "    }\n";
        }
    }
    out + "    return g;\n}\n"
}

fn looped(degree: usize) -> String {
    let n = 3 * degree;
    let b = list(binomials(n).into_iter().map(f64::from));
    let e = list(binomials(n - 1).into_iter().map(f64::from));
    let inverse = list(binomials(n).into_iter().map(|x| 1.0 / f64::from(x)));
    let count = n + 1;
    let double = 2 * degree;
    format!(
        "\
struct Poly {{ c: array<f32, {count}> }}
fn first_of(p: Poly) -> f32 {{ return p.c[0]; }}
fn last_of(p: Poly) -> f32 {{ return p.c[{n}]; }}
fn with_first(p: Poly, x: f32) -> Poly {{
    var out = p;
    out.c[0] = x;
    return out;
}}
fn bounds(p: Poly) -> vec2<f32> {{
    var c = p.c;
    var r = vec2(c[0], c[0]);
    for (var i = 1; i <= {n}; i++) {{
        r = vec2(min(r.x, c[i]), max(r.y, c[i]));
    }}
    return r;
}}
fn changes(p: Poly, v: f32) -> u32 {{
    var c = p.c;
    var found = 0u;
    for (var i = 0; i < {n}; i++) {{
        found += select(0u, 1u, (c[i] < v) != (c[i + 1] < v));
    }}
    return found;
}}
fn is_monotone(p: Poly) -> bool {{
    var c = p.c;
    var rises = true;
    var falls = true;
    for (var i = 0; i < {n}; i++) {{
        rises = rises && c[i] <= c[i + 1];
        falls = falls && c[i] >= c[i + 1];
    }}
    return rises || falls;
}}
fn evaluate(p: Poly, x: f32) -> vec2<f32> {{
    var c = p.c;
    var b = array<f32, {count}>({b});
    var e = array<f32, {n}>({e});
    let y = 1.0 - x;
    var t = x;
    var f = c[0];
    var g = c[1] - c[0];
    for (var i = 1; i <= {n}; i++) {{
        f = f * y + b[i] * c[i] * t;
        if i < {n} {{
            g = g * y + e[i] * (c[i + 1] - c[i]) * t;
        }}
        t *= x;
    }}
    return vec2(f, {n}.0 * g);
}}
fn part_of(p: Poly, lo: f32, hi: f32) -> Poly {{
    let y = 1.0 - hi;
    let v = lo / hi;
    let u = 1.0 - v;
    var c = p.c;
    for (var r = 1; r <= {n}; r++) {{
        for (var i = {n}; i >= r; i--) {{
            c[i] = y * c[i - 1] + hi * c[i];
        }}
    }}
    for (var r = 1; r <= {n}; r++) {{
        for (var i = 0; i <= {n} - r; i++) {{
            c[i] = u * c[i] + v * c[i + 1];
        }}
    }}
    return Poly(c);
}}
fn rows(b: Basis) -> array<vec4<f32>, 4> {{
    return array<vec4<f32>, 4>(b.j0, b.j1, b.j2, b.j3);
}}
fn compose(cell: vec3<i32>, a: vec3<f32>, b: vec3<f32>) -> Poly {{
    var bx = rows(basis(a.x, b.x));
    var by = rows(basis(a.y, b.y));
    var bz = rows(basis(a.z, b.z));
    var ix = indices(cell.x, params.last.x);
    var iy = indices(cell.y, params.last.y);
    var iz = indices(cell.z, params.last.z);
    var inverse = array<f32, {count}>({inverse});
    var c = array<f32, {count}>();
    for (var k = 0; k <= {degree}; k++) {{
        var q = array<f32, {}>();
        for (var j = 0; j <= {degree}; j++) {{
            var r = vec4(0.0);
            for (var i = 0; i <= {degree}; i++) {{
                r += coefficient(vec3(ix[i], iy[j], iz[k])) * bx[i];
            }}
            for (var m = 0; m <= {degree}; m++) {{
                for (var i = 0; i <= {degree}; i++) {{
                    q[m + i] += by[j][m] * r[i];
                }}
            }}
        }}
        for (var m = 0; m <= {degree}; m++) {{
            for (var i = 0; i <= {double}; i++) {{
                c[m + i] += bz[k][m] * q[i];
            }}
        }}
    }}
    for (var i = 0; i <= {n}; i++) {{
        c[i] *= inverse[i];
    }}
    return Poly(c);
}}
{GRADIENT}\
    for (var k = 0; k <= {degree}; k++) {{
        for (var j = 0; j <= {degree}; j++) {{
            var v = 0.0;
            var d = 0.0;
            for (var i = 0; i <= {degree}; i++) {{
                let s = coefficient(vec3(ix[i], iy[j], iz[k]));
                v += s * wx[i];
                d += s * dx[i];
            }}
            g += vec3(wz[k] * wy[j] * d, wz[k] * dy[j] * v, dz[k] * wy[j] * v);
        }}
    }}
    return g;
}}
",
        double + 1
    )
}
