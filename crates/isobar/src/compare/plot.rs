//! The curve of time against error over a sweep, as inline SVG.

use super::Row;
use crate::settings::{escape, short};
use std::fmt::Write;

const W: f64 = 640.0;
const H: f64 = 360.0;
const LEFT: f64 = 70.0;
const BOTTOM: f64 = 46.0;
/// Line colours, told apart also without colour by the labels.
const COLOURS: [&str; 6] = ["#1f6fb4", "#c2571a", "#2e8b57", "#7b4ba0", "#a3282d", "#555555"];

struct Axis {
    lo: f64,
    hi: f64,
}

impl Axis {
    /// Whole decades around the values.
    fn new(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (lo, hi) = values
            .filter(|v| *v > 0.0)
            .fold((f64::MAX, 0.0f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        (hi > 0.0).then(|| {
            let lo = lo.log10().floor();
            Self {
                lo,
                hi: hi.log10().ceil().max(lo + 1.0),
            }
        })
    }

    fn at(&self, v: f64) -> f64 {
        ((v.log10() - self.lo) / (self.hi - self.lo)).clamp(0.0, 1.0)
    }

    fn decades(&self) -> impl Iterator<Item = f64> {
        (self.lo as i32..=self.hi as i32).map(|d| 10f64.powi(d))
    }
}

/// Median rendering time over the 99th percentile of the error in t, logarithmic, one line per method; settings with wrong pixels are
/// drawn hollow. Errors of 0 lie on the left border. Empty where no row was checked.
#[must_use]
pub fn curve(rows: &[Row]) -> String {
    let points: Vec<(&str, &str, f64, f64, bool)> = rows
        .iter()
        .filter_map(|r| {
            let m = r.result.as_ref().ok()?;
            let c = m.check.as_ref()?;
            Some((
                r.method.id,
                r.setting.as_str(),
                c.t_error_voxels.p99,
                m.render.median,
                crate::checking::wrong(c) == 0,
            ))
        })
        .collect();
    let (Some(x), Some(y)) = (
        Axis::new(points.iter().map(|p| p.2.max(1e-16))),
        Axis::new(points.iter().map(|p| p.3)),
    ) else {
        return String::new();
    };
    let px = |v: f64| LEFT + x.at(v.max(1e-16)) * (W - LEFT - 20.0);
    let py = |v: f64| H - BOTTOM - y.at(v) * (H - BOTTOM - 20.0);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {W} {H}\" width=\"{W}\" height=\"{H}\" role=\"img\" aria-label=\"time against error\" \
         font-family=\"sans-serif\" font-size=\"11\"><rect width=\"{W}\" height=\"{H}\" fill=\"#fff\"/>"
    );
    // Writing to a String cannot fail.
    for d in x.decades() {
        let _ = write!(
            svg,
            "<path d=\"M{0:.1} 20V{1}\" stroke=\"#ddd\"/><text x=\"{0:.1}\" y=\"{2}\" text-anchor=\"middle\">{3}</text>",
            px(d),
            H - BOTTOM,
            H - BOTTOM + 15.0,
            short_power(d)
        );
    }
    for d in y.decades() {
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {0:.1}H{1}\" stroke=\"#ddd\"/><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\">{4} s</text>",
            py(d),
            W - 20.0,
            LEFT - 6.0,
            py(d) + 4.0,
            short_power(d)
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">error of t, 99th percentile, voxels</text>",
        (W + LEFT) / 2.0,
        H - 8.0
    );
    let mut ids: Vec<&str> = points.iter().map(|p| p.0).collect();
    ids.dedup();
    for (n, id) in ids.iter().enumerate() {
        let colour = COLOURS[n % COLOURS.len()];
        let of: Vec<_> = points.iter().filter(|p| p.0 == *id).collect();
        let line: Vec<String> = of.iter().map(|p| format!("{:.1},{:.1}", px(p.2), py(p.3))).collect();
        let _ = write!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\"/>",
            line.join(" ")
        );
        for p in &of {
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"4\" stroke=\"{colour}\" fill=\"{}\"><title>{} {}: {} voxels, {} s</title></circle>",
                px(p.2),
                py(p.3),
                if p.4 { colour } else { "#fff" },
                escape(p.0),
                escape(p.1),
                short(p.2),
                short(p.3)
            );
        }
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\" fill=\"{colour}\" text-anchor=\"end\">{}</text>",
            W - 26.0,
            34.0 + 14.0 * n as f64,
            escape(id)
        );
    }
    svg.push_str("</svg>");
    svg
}

fn short_power(v: f64) -> String {
    if (1e-3..1e4).contains(&v) {
        short(v)
    } else {
        format!("{v:.0e}")
    }
}
