//! Charts as SVG text, to stand inside the page.

use crate::results::{Convergence, Row};
use anyhow::{Result, anyhow};
use plotters::coord::combinators::LogCoord;
use plotters::prelude::*;
use std::ops::Range;

/// Colours of methods, by position in the list of methods: dark enough on white, the first eight distinct also without colour vision.
pub const COLOURS: [RGBColor; 12] = [
    RGBColor(31, 95, 168),
    RGBColor(200, 92, 20),
    RGBColor(30, 130, 90),
    RGBColor(150, 60, 140),
    RGBColor(120, 100, 30),
    RGBColor(70, 70, 70),
    RGBColor(190, 40, 60),
    RGBColor(20, 140, 170),
    RGBColor(95, 75, 190),
    RGBColor(115, 140, 20),
    RGBColor(175, 60, 130),
    RGBColor(140, 80, 50),
];

/// Errors below this are drawn here: a logarithm needs a floor.
const FLOOR: f64 = 1e-14;

const INK: RGBColor = RGBColor(40, 44, 52);
const FAINT: RGBColor = RGBColor(228, 230, 234);

/// As `#rrggbb`.
#[must_use]
pub fn hex(c: RGBColor) -> String {
    format!("#{:02x}{:02x}{:02x}", c.0, c.1, c.2)
}

/// The range of some positive values in whole decades, one decade at least.
fn decades(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (lo, hi) = values.filter(|v| v.is_finite()).fold((f64::INFINITY, 0.0f64), |(lo, hi), v| {
        (lo.min(v.max(FLOOR)), hi.max(v.max(FLOOR)))
    });
    if lo > hi {
        return 1e-3..1.0;
    }
    let (a, b) = (lo.log10().floor(), hi.log10().ceil());
    10f64.powf(a)..10f64.powf(if b > a { b } else { a + 1.0 })
}

/// A short number for an axis: `0.01`, `1`, `1e-9`; empty but at 1, 2 and 5 times a power of ten.
fn tick(v: &f64) -> String {
    let mantissa = v / 10f64.powf((v.log10() + 1e-9).floor());
    if ![1.0, 2.0, 5.0].iter().any(|m| (mantissa - m).abs() < 1e-6) {
        return String::new();
    }
    if (1e-3..1e5).contains(v) {
        format!("{}", (v * 1e9).round() / 1e9)
    } else {
        format!("{v:.0e}")
    }
}

/// A chart with both axes logarithmic.
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<LogCoord<f64>, LogCoord<f64>>>;

/// What an axis shows.
struct Axis<'a> {
    range: Range<f64>,
    title: &'a str,
    label: fn(&f64) -> String,
}

/// A chart of `size` pixels with axes drawn, filled by `body`, as SVG text that shrinks with the page.
fn draw(size: (u32, u32), x: Axis<'_>, y: Axis<'_>, body: impl FnOnce(&mut Chart<'_, '_>) -> Result<()>) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        let mut chart = ChartBuilder::on(&area)
            .margin(8)
            .margin_right(18)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d(x.range.log_scale(), y.range.log_scale())
            .map_err(failed)?;
        chart
            .configure_mesh()
            .axis_style(INK)
            .bold_line_style(FAINT)
            .light_line_style(TRANSPARENT)
            .label_style(("sans-serif", 13).into_font().color(&INK))
            .x_desc(x.title)
            .y_desc(y.title)
            .x_label_formatter(&x.label)
            .y_label_formatter(&y.label)
            .draw()
            .map_err(failed)?;
        body(&mut chart)?;
        drop(chart);
        area.present().map_err(failed)?;
    }
    // A view box instead of a fixed size.
    let from = format!("<svg width=\"{}\" height=\"{}\"", size.0, size.1);
    Ok(text.replacen(&from, &format!("<svg class=\"chart\" style=\"max-width:{}px\"", size.0), 1))
}

fn failed(e: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("a chart could not be drawn: {e}")
}

/// Samples per axis: from the least to the greatest, with some room.
fn samples_axis(counts: &[f64]) -> Axis<'static> {
    let lo = counts.iter().copied().fold(f64::INFINITY, f64::min);
    let hi = counts.iter().copied().fold(0.0, f64::max);
    Axis {
        range: lo * 0.9..hi * 1.1,
        title: "samples per axis",
        label: |v| format!("{v:.0}"),
    }
}

/// A line with dots.
fn dotted(chart: &mut Chart<'_, '_>, points: &[(f64, f64)], colour: RGBColor) -> Result<()> {
    chart
        .draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))
        .map_err(failed)?;
    chart
        .draw_series(points.iter().map(|p| Circle::new(*p, 4, colour.filled())))
        .map_err(failed)?;
    Ok(())
}

/// What the error of a chart is against. Never two in one chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Against {
    /// Certified roots: 99th percentile of right hits, voxels.
    Roots,
    /// Peaks and the integral between: 99th percentile of the colours, of settings that draw peaks.
    Peaks,
    /// The integral: the same, of settings that draw no peaks.
    Integral,
}

impl Against {
    fn title(self) -> &'static str {
        match self {
            Self::Roots => "error, voxels (99 % of hits)",
            Self::Peaks => "error of colour against peaks (99 %)",
            Self::Integral => "error of colour against the integral (99 %)",
        }
    }

    /// A row's error; `None` where it is no row of this chart.
    fn error(self, r: &Row) -> Option<f64> {
        match (self, &r.colour) {
            (Self::Roots, None) => Some(r.checked.t_voxels.p99),
            (Self::Peaks, Some(c)) => c.peaks?.p99,
            (Self::Integral, Some(c)) if c.peaks.is_none() => c.integral.p99,
            _ => None,
        }
    }
}

/// Time against error over the knob sweeps: one line per method, from `rows`. Points of frames with wrong pixels are hollow. `None` where no row has numbers.
///
/// # Errors
/// When the chart cannot be drawn.
pub fn time_against_error(rows: &[Row], methods: &[String], against: Against) -> Result<Option<String>> {
    let measured = rows.iter().filter(|r| r.reason.is_none() && r.wall.median > 0.0);
    let good: Vec<&Row> = measured.filter(|r| against.error(r).is_some()).collect();
    if good.is_empty() {
        return Ok(None);
    }
    let ms = |r: &Row| r.wall.median * 1e3;
    let error = |r: &Row| against.error(r).unwrap_or_default().max(FLOOR);
    let x = Axis {
        range: decades(good.iter().map(|r| ms(r))),
        title: "time of a frame, ms (wall clock)",
        label: tick,
    };
    let y = Axis {
        range: decades(good.iter().map(|r| error(r))),
        title: against.title(),
        label: tick,
    };
    let text = draw((620, 360), x, y, |chart| {
        for (i, m) in methods.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            let mut own: Vec<&Row> = good.iter().copied().filter(|r| r.method == *m).collect();
            if own.is_empty() {
                continue;
            }
            own.sort_by(|a, b| ms(a).total_cmp(&ms(b)));
            let points: Vec<(f64, f64)> = own.iter().map(|r| (ms(r), error(r))).collect();
            chart
                .draw_series(LineSeries::new(points.iter().copied(), colour.mix(0.5).stroke_width(1)))
                .map_err(failed)?;
            let marks = own.iter().zip(&points).flat_map(|(r, p)| {
                let ring = Circle::new(*p, 5, colour.stroke_width(2)).into_dyn();
                let inside = if r.checked.wrong() == 0 {
                    colour.filled()
                } else {
                    WHITE.filled()
                };
                [Circle::new(*p, 5, inside).into_dyn(), ring]
            });
            chart.draw_series(marks).map_err(failed)?;
        }
        Ok(())
    })?;
    Ok(Some(text))
}

/// Error against samples per axis, for reconstructions of one field; `normal` picks the angle instead of the distance. Dashed: the slope
/// of the theory through the last point.
///
/// # Errors
/// When the chart cannot be drawn.
pub fn convergence(series: &[&Convergence], normal: bool) -> Result<Option<String>> {
    let values = |c: &Convergence| if normal { c.normal.clone() } else { c.position.clone() };
    let counts: Vec<f64> = series.iter().flat_map(|c| c.n.iter().map(|&n| n as f64)).collect();
    if counts.is_empty() {
        return Ok(None);
    }
    let y = Axis {
        range: decades(series.iter().flat_map(|c| values(c))),
        title: if normal {
            "normal error, degrees"
        } else {
            "position error, box units"
        },
        label: tick,
    };
    let text = draw((470, 340), samples_axis(&counts), y, |chart| {
        for (i, c) in series.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            let points: Vec<(f64, f64)> = c.n.iter().map(|&n| n as f64).zip(values(c)).collect();
            let Some(&(n1, e1)) = points.last() else { continue };
            let order = c.theory[usize::from(normal)];
            let theory = points.iter().map(|&(n, _)| (n, e1 * ((n1 - 1.0) / (n - 1.0)).powf(order)));
            chart
                .draw_series(DashedLineSeries::new(theory, 4, 4, colour.mix(0.6).stroke_width(1)))
                .map_err(failed)?;
            dotted(chart, &points, colour)?;
        }
        Ok(())
    })?;
    Ok(Some(text))
}

/// Time of a frame against samples per axis over the definitions of `sweep/`: `(n, ms)` by method.
///
/// # Errors
/// When the chart cannot be drawn.
pub fn growth(series: &[(usize, Vec<(f64, f64)>)]) -> Result<Option<String>> {
    let xs: Vec<f64> = series.iter().flat_map(|(_, p)| p.iter().map(|p| p.0)).collect();
    if xs.is_empty() {
        return Ok(None);
    }
    let y = Axis {
        range: decades(series.iter().flat_map(|(_, p)| p.iter().map(|p| p.1))),
        title: "time of a frame, ms (wall clock)",
        label: tick,
    };
    let text = draw((470, 320), samples_axis(&xs), y, |chart| {
        for (i, points) in series {
            dotted(chart, points, COLOURS[i % COLOURS.len()])?;
        }
        Ok(())
    })?;
    Ok(Some(text))
}

/// Time against the side of a square image: `(pixels, ms)` by series, in the order of [`COLOURS`].
///
/// # Errors
/// When the chart cannot be drawn.
pub fn sizes(series: &[Vec<(f64, f64)>]) -> Result<Option<String>> {
    let all = || series.iter().flatten();
    if all().next().is_none() {
        return Ok(None);
    }
    let x = Axis {
        title: "pixels along the image",
        ..samples_axis(&all().map(|p| p.0).collect::<Vec<_>>())
    };
    let y = Axis {
        range: decades(all().map(|p| p.1)),
        title: "ms (wall clock)",
        label: tick,
    };
    let text = draw((470, 340), x, y, |chart| {
        for (i, points) in series.iter().enumerate() {
            dotted(chart, points, COLOURS[i % COLOURS.len()])?;
        }
        Ok(())
    })?;
    Ok(Some(text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Checked, Spread, Stat};

    fn row(method: &str, ms: f64, p99: f64, missed: u64) -> Row {
        Row {
            method: method.into(),
            wall: Stat {
                median: ms * 1e-3,
                mad: 0.0,
                n: 5,
            },
            checked: Checked {
                missed,
                t_voxels: Spread {
                    median: 0.0,
                    p99,
                    max: p99,
                },
                ..Checked::default()
            },
            ..Row::default()
        }
    }

    #[test]
    fn frames_with_wrong_pixels_are_hollow() {
        let methods = ["a".to_owned()];
        let chart = |missed| {
            time_against_error(&[row("a", 12.0, 1e-3, missed)], &methods, Against::Roots)
                .unwrap()
                .unwrap()
        };
        let white = |s: &str| s.matches("#FFFFFF").count();
        assert!(white(&chart(7)) > white(&chart(0)));
        assert!(chart(0).contains("<svg class=\"chart\" style"));
        assert!(chart(0).contains("voxels"));
    }

    #[test]
    fn rows_without_numbers_make_no_chart() {
        let mut r = row("a", 1.0, 1.0, 0);
        r.reason = Some("refused".into());
        assert_eq!(time_against_error(&[r], &["a".to_owned()], Against::Roots).unwrap(), None);
        let r = row("a", 1.0, 1.0, 0);
        assert_eq!(time_against_error(&[r], &["a".to_owned()], Against::Peaks).unwrap(), None);
        assert_eq!(convergence(&[], false).unwrap(), None);
        assert_eq!(growth(&[]).unwrap(), None);
        assert_eq!(sizes(&[Vec::new()]).unwrap(), None);
    }

    #[test]
    fn decades_hold_the_values() {
        assert_eq!(decades([0.2, 30.0].into_iter()), 0.1..100.0);
        assert_eq!(decades([1.0].into_iter()), 1.0..10.0);
        assert!(decades([0.0].into_iter()).start > 0.0);
    }
}
