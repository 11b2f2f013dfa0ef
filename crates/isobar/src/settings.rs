//! Settings, numbers and views as text and JSON.

use anyhow::{Result, anyhow, bail};
use isobar_core::{
    Camera, DVec3, KnobKind, KnobSpec, KnobValue, Knobs, Method, RenderError, ResolvedKnobs, Surface, SurfaceKind, View,
};
use serde_json::{Map, Value, json};

/// Reads `knob=value,...`, each given to `--set`.
///
/// # Errors
/// When a part is not `knob=value`.
pub fn parse_knobs<S: AsRef<str>>(given: &[S]) -> Result<Knobs> {
    let mut knobs = Knobs::default();
    for part in given.iter().flat_map(|s| s.as_ref().split(',')) {
        match part.split_once('=') {
            Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => knobs.set(name.trim(), value.trim()),
            _ => bail!("--set {part}: not knob=value; write --set step=0.5,claims=on"),
        }
    }
    Ok(knobs)
}

/// All settings of a method with these knobs, defaults filled in.
///
/// # Errors
/// When a knob does not exist or its value is out of range; the text names `--set` and the method.
pub fn resolve(method: &dyn Method, knobs: &Knobs) -> Result<ResolvedKnobs> {
    let info = method.info();
    ResolvedKnobs::new(info.knobs, knobs).map_err(|e| match e {
        RenderError::Knob { name, reason } => anyhow!("--set {name}: {reason} ({}; see isobar methods)", info.id),
        other => anyhow!("--set: {other}"),
    })
}

/// A renderer's error as a line that names the flag or file it is about.
#[must_use]
pub fn explain(error: &RenderError, method: &str, data: &str) -> anyhow::Error {
    match error {
        RenderError::View(s) => anyhow!("the view: {s}"),
        // Its text begins with the method.
        RenderError::Unsupported(u) => anyhow!("--method {u}; isobar methods lists what each can"),
        RenderError::Knob { name, reason } => anyhow!("--set {name}: {reason} ({method}; see isobar methods)"),
        RenderError::Data(d) => anyhow!("DATA {data}: {d}"),
        RenderError::Memory { .. } => anyhow!("{error}; give a smaller --size, fewer --layers or smaller data"),
        RenderError::Device(s) => anyhow!("--method {method}: the device failed ({s}); try again, or use a cpu method"),
        _ => anyhow!("--method {method}: {error}"),
    }
}

/// A number in few characters that still tells neighbours apart: up to 7 significant digits.
#[must_use]
pub fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return v.to_string();
    }
    let digits = 6 - v.abs().log10().floor() as i32;
    if (0..=12).contains(&digits) {
        let s = format!("{v:.*}", digits as usize);
        if s.contains('.') {
            s.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            s
        }
    } else {
        format!("{v:.6e}")
    }
}

/// Seconds with a unit people think in.
#[must_use]
pub fn seconds(s: f64) -> String {
    if s < 1e-3 {
        format!("{:.1} us", s * 1e6)
    } else if s < 1.0 {
        format!("{:.2} ms", s * 1e3)
    } else {
        format!("{s:.2} s")
    }
}

/// Text made safe inside HTML and SVG, also inside quoted attributes.
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A float as JSON; null where it is not finite.
#[must_use]
pub fn finite(v: f64) -> Value {
    if v.is_finite() { json!(v) } else { Value::Null }
}

fn vector(v: DVec3) -> Value {
    json!(v.to_array())
}

/// Settings as JSON.
#[must_use]
pub fn knobs_json(knobs: &ResolvedKnobs) -> Value {
    let value = |v: &KnobValue| match v {
        KnobValue::Int(i) => json!(i),
        KnobValue::Float(f) => finite(*f),
        KnobValue::Word(w) => json!(w),
    };
    Value::Object(knobs.iter().map(|(k, v)| (k.to_owned(), value(v))).collect())
}

/// Settings as `name=value name=value`.
#[must_use]
pub fn knobs_text(knobs: &ResolvedKnobs) -> String {
    knobs.iter().map(|(k, v)| format!("{k}={v}")).collect::<Vec<_>>().join(" ")
}

/// A knob's range and default as JSON.
#[must_use]
pub fn knob_json(spec: &KnobSpec) -> Value {
    let mut out = Map::new();
    out.insert("name".into(), json!(spec.name));
    out.insert("doc".into(), json!(spec.doc));
    let (kind, default, range) = match spec.kind {
        KnobKind::Int { default, min, max } => ("int", json!(default), json!([min, max])),
        KnobKind::Float { default, min, max } => ("float", finite(default), json!([finite(min), finite(max)])),
        KnobKind::Choice(words) => ("choice", json!(words[0]), json!(words)),
    };
    out.insert("type".into(), json!(kind));
    out.insert("default".into(), default);
    out.insert(if kind == "choice" { "choices" } else { "range" }.into(), range);
    Value::Object(out)
}

/// A view as JSON.
#[must_use]
pub fn view_json(view: &View) -> Value {
    let camera = match &view.camera {
        Camera::Perspective { eye, target, up, fov } => {
            json!({"kind": "perspective", "eye": vector(*eye), "target": vector(*target), "up": vector(*up), "fov": fov})
        }
        Camera::Orthographic { eye, target, up, height } => {
            json!({"kind": "orthographic", "eye": vector(*eye), "target": vector(*target), "up": vector(*up), "height": height})
        }
        Camera::Rays(rays) => json!({"kind": "rays", "count": rays.len()}),
    };
    let clips: Vec<Value> = view
        .clips
        .iter()
        .map(|c| json!({"normal": vector(c.normal), "distance": c.distance, "cap": c.cap}))
        .collect();
    json!({"size": [view.width, view.height], "camera": camera, "clips": clips})
}

/// Surfaces as JSON; colours are linear.
#[must_use]
pub fn surfaces_json(surfaces: &[Surface]) -> Value {
    surfaces
        .iter()
        .map(|s| {
            let mut out = json!({"isovalue": s.value(), "opacity": s.opacity, "colour": s.colour});
            match s.kind {
                SurfaceKind::Parameter { axis, value } => out["parameter"] = json!({"axis": axis, "value": value}),
                SurfaceKind::Boundary => out["boundary"] = json!(true),
                _ => {}
            }
            out
        })
        .collect()
}

/// JSON over several lines, ending in a line end.
#[must_use]
pub fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knobs_are_read() {
        let k = parse_knobs(&["step=0.5, claims=on", "n=3"]).unwrap();
        assert_eq!(k, Knobs::default().with("step", 0.5).with("claims", "on").with("n", 3));
        for bad in ["step", "=1", "a=", "a=1,,b=2", ""] {
            assert!(parse_knobs(&[bad]).unwrap_err().to_string().starts_with("--set"), "{bad}");
        }
    }

    #[test]
    fn numbers_are_short_and_true() {
        for (v, s) in [
            (0.0, "0"),
            (0.5, "0.5"),
            (128.5, "128.5"),
            (1e-9, "1.000000e-9"),
            (65_535.5, "65535.5"),
            (-2.25, "-2.25"),
            (1_048_576.0, "1048576"),
            (123_456_789.0, "1.234568e8"),
        ] {
            assert_eq!(short(v), s);
        }
        assert_eq!(seconds(0.25), "250.00 ms");
    }
}
