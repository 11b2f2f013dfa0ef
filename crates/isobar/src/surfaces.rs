//! Isovalues with colour and opacity, and transfer functions.

use crate::cli::MoreSurfaces;
use crate::settings::short;
use anyhow::{Context, Result, anyhow, bail, ensure};
use isobar_core::{Surface, SurfaceKind, TransferFunction};
use serde::Deserialize;
use std::io::Read;
use std::path::Path;

/// Most surfaces a scene may have: the frame's index has 8 bits, 255 means none, and one index is left for a mesh.
pub const MAX_SURFACES: usize = 254;

/// Longest file of a transfer function, bytes: some 50,000 points.
const MOST_TEXT: u64 = 4 << 20;
/// Greatest optical depth across the data: its products with lengths and colours stay far inside f32, which devices count in. Beyond 100, light is
/// gone anyway.
const MOST_DEPTH: f64 = 1e30;

/// All surfaces of a scene: the isovalues, then the values of parameters, then the boundary.
///
/// # Errors
/// As [`parse_isovalues`]; for `--parameter` and `--boundary` too.
pub fn parse<S: AsRef<str>>(isovalues: &[S], more: &MoreSurfaces) -> Result<Vec<Surface>> {
    let mut out = parse_isovalues(isovalues)?;
    for (text, part) in more.parameter.iter().flat_map(|s| s.split(',').map(move |part| (s, part))) {
        let (place, look) = part.trim().split_once(':').unwrap_or((part.trim(), ""));
        let (axis, value) = place.split_once('=').unwrap_or((place, ""));
        let axis = ["u", "v", "w"].iter().position(|a| *a == axis);
        let value = value.parse::<f64>().ok().filter(|v| (0.0..=1.0).contains(v));
        let (Some(axis), Some(value)) = (axis, value) else {
            bail!(
                "--parameter {text}: \"{place}\" is not u, v or w = a number from 0 to 1; write u=0.5[:opacity[:#rrggbb]][,...]"
            );
        };
        let kind = SurfaceKind::Parameter { axis: axis as u8, value };
        out.push(styled(
            "--parameter",
            text,
            look,
            Surface {
                kind,
                ..Surface::isovalue(0.0, out.len())
            },
        )?);
    }
    if let Some(look) = &more.boundary {
        let kind = SurfaceKind::Boundary;
        out.push(styled(
            "--boundary",
            look,
            look,
            Surface {
                kind,
                ..Surface::isovalue(0.0, out.len())
            },
        )?);
    }
    ensure!(
        out.len() <= MAX_SURFACES,
        "--parameter: more than {MAX_SURFACES} surfaces; draw them in several images"
    );
    Ok(out)
}

/// With the opacity and colour of `opacity[:#rrggbb]`.
fn styled(flag: &str, text: &str, look: &str, mut surface: Surface) -> Result<Surface> {
    let (opacity, colour) = look.split_once(':').map_or((look, None), |(o, c)| (o, Some(c)));
    if !opacity.is_empty() {
        surface.opacity = match opacity.parse::<f32>() {
            Ok(v) if (0.0..=1.0).contains(&v) => v,
            _ => bail!("{flag} {text}: opacity \"{opacity}\" is not a number from 0 to 1"),
        };
    }
    if let Some(colour) = colour {
        surface.colour = parse_colour(colour)
            .with_context(|| format!("{flag} {text}: colour \"{colour}\" is not #rrggbb; write six hexadecimal digits"))?;
    }
    Ok(surface)
}

/// Reads `C[:opacity[:#rrggbb]][,...]`, each given to `--isovalue`. The colour is sRGB and is stored linear; without one the
/// surface has the default colour of its position. An empty opacity is 1.
///
/// # Errors
/// When a number, opacity or colour cannot be read, or there are too many; the text names the flag and the part.
pub fn parse_isovalues<S: AsRef<str>>(given: &[S]) -> Result<Vec<Surface>> {
    let mut out = Vec::new();
    for (text, part) in given
        .iter()
        .map(AsRef::as_ref)
        .flat_map(|s| s.split(',').map(move |part| (s, part)))
    {
        let (value, look) = part.trim().split_once(':').unwrap_or((part.trim(), ""));
        let Some(c) = value.parse::<f64>().ok().filter(|c| c.is_finite()) else {
            bail!("--isovalue {text}: \"{value}\" is not a finite number; write C[:opacity[:#rrggbb]][,...]");
        };
        out.push(styled("--isovalue", text, look, Surface::isovalue(c, out.len()))?);
        ensure!(
            out.len() <= MAX_SURFACES,
            "--isovalue: more than {MAX_SURFACES} surfaces; draw them in several images"
        );
    }
    Ok(out)
}

/// `#rrggbb` in sRGB as linear RGB in [0, 1]; `None` where it is not that.
#[must_use]
pub fn parse_colour(s: &str) -> Option<[f32; 3]> {
    let hex = s
        .strip_prefix('#')
        .filter(|h| h.len() == 6 && h.bytes().all(|b| b.is_ascii_hexdigit()))?;
    let mut out = [0.0; 3];
    for (i, c) in out.iter_mut().enumerate() {
        *c = srgb_to_linear(u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).ok()?);
    }
    Some(out)
}

fn srgb_to_linear(v: u8) -> f32 {
    let s = f64::from(v) / 255.0;
    (if s <= 0.040_45 {
        s / 12.92
    } else {
        ((s + 0.055) / 1.055).powf(2.4)
    }) as f32
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TransferFile {
    points: Vec<Vec<f64>>,
    unit: Option<f64>,
}

/// Reads a transfer function: TOML with `points = [[value, r, g, b, density], ...]` (data units ascending, linear RGB in [0, 1],
/// density not negative) and optionally `unit`, the world length density refers to, by default `extent / 256`.
///
/// # Errors
/// When the file cannot be read or is not that; one line that names the file and the point.
pub fn load_transfer(path: &Path, extent: f64) -> Result<TransferFunction> {
    let name = path.display();
    let remedy = "give a readable TOML file with points = [[value, r, g, b, density], ...]";
    let meta = std::fs::metadata(path).map_err(|e| anyhow!("--tf {name}: {e}; {remedy}"))?;
    ensure!(meta.is_file(), "--tf {name}: is no ordinary file; {remedy}");
    let mut text = String::new();
    std::fs::File::open(path)
        .and_then(|f| f.take(MOST_TEXT + 1).read_to_string(&mut text))
        .map_err(|e| anyhow!("--tf {name}: {e}; {remedy}"))?;
    ensure!(
        text.len() as u64 <= MOST_TEXT,
        "--tf {name}: is longer than {MOST_TEXT} bytes; {remedy}"
    );
    parse_transfer(&text, extent).map_err(|e| anyhow!("--tf {name}: {e}"))
}

fn parse_transfer(text: &str, extent: f64) -> Result<TransferFunction> {
    let file: TransferFile = toml::from_str(text).map_err(|e| {
        let line = e
            .span()
            .map_or(1, |s| text[..s.start.min(text.len())].matches('\n').count() + 1);
        anyhow!(
            "line {line}: {}; write points = [[value, r, g, b, density], ...]",
            e.message()
        )
    })?;
    let points = file
        .points
        .iter()
        .enumerate()
        .map(|(i, p)| match p[..] {
            [value, r, g, b, density] => Ok((value, [r as f32, g as f32, b as f32], density as f32)),
            _ => bail!(
                "point {} has {} numbers; write five: [value, r, g, b, density]",
                i + 1,
                p.len()
            ),
        })
        .collect::<Result<Vec<_>>>()?;
    let transfer = TransferFunction::new(points, file.unit.unwrap_or(extent / 256.0))?;
    let densest = transfer.points.iter().fold(0.0f64, |m, p| m.max(f64::from(p.2)));
    let depth = densest / transfer.unit * extent;
    ensure!(
        depth <= MOST_DEPTH,
        "density {} per unit of {} is an optical depth of {} across the data, more than the {MOST_DEPTH:e} that can be drawn; give smaller \
         densities or a longer unit",
        short(densest),
        short(transfer.unit),
        short(depth)
    );
    Ok(transfer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isovalues_have_opacity_and_linear_colour() {
        let s = parse_isovalues(&["-0.5", "1e2:0.25:#ff0080,3::#000000,4:0"]).unwrap();
        assert_eq!(
            s.iter().map(|s| s.value().unwrap()).collect::<Vec<_>>(),
            [-0.5, 100.0, 3.0, 4.0]
        );
        assert_eq!(s.iter().map(|s| s.opacity).collect::<Vec<_>>(), [1.0, 0.25, 1.0, 0.0]);
        assert_eq!((s[1].colour[0], s[1].colour[1]), (1.0, 0.0));
        assert!((s[1].colour[2] - 0.215_860_5).abs() < 1e-6, "sRGB 128 is linear 0.2159");
        assert_eq!(s[3].colour, Surface::COLOURS[3]);
        // and back: the picture has the colour asked for
        assert_eq!(
            isobar_core::to_srgb8([s[1].colour[0], s[1].colour[1], s[1].colour[2], 1.0]),
            [255, 0, 128]
        );
    }

    #[test]
    fn unusable_isovalues_are_one_line() {
        for bad in [
            "nan",
            "",
            "1,",
            "inf",
            "1:2",
            "1:-0.1",
            "1:nan",
            "1:1:red",
            "1:1:#12345",
            "1:1:#gggggg",
            "1:1:#é1234",
        ] {
            let e = parse_isovalues(&[bad]).unwrap_err().to_string();
            assert!(e.starts_with("--isovalue") && !e.contains('\n'), "{bad}: {e}");
        }
        assert!(parse_isovalues(&vec!["1"; 255]).is_err());
    }

    #[test]
    fn parameters_and_the_boundary_follow_the_isovalues() {
        let more = |p: &str, b: Option<&str>| MoreSurfaces {
            parameter: vec![p.to_owned()],
            boundary: b.map(str::to_owned),
        };
        let s = parse(&["1"], &more("u=0.5,w=1:0.25:#ff0000", Some("0.3"))).unwrap();
        assert_eq!(s.len(), 4);
        assert_eq!(s[1].kind, SurfaceKind::Parameter { axis: 0, value: 0.5 });
        assert_eq!(s[2].kind, SurfaceKind::Parameter { axis: 2, value: 1.0 });
        assert_eq!((s[2].opacity, s[2].colour[0], s[2].colour[1]), (0.25, 1.0, 0.0));
        assert_eq!((s[3].kind, s[3].opacity), (SurfaceKind::Boundary, 0.3));
        assert_eq!(s[3].colour, Surface::COLOURS[3 % Surface::COLOURS.len()]);
        for bad in ["x=0.5", "u", "u=1.5", "u=nan", "u=0.5:2", "u=0.5:1:red", ""] {
            let e = parse::<&str>(&[], &more(bad, None)).unwrap_err().to_string();
            assert!(e.starts_with("--parameter") && !e.contains('\n'), "{bad}: {e}");
        }
        let e = parse::<&str>(&[], &more("u=0", Some("x"))).unwrap_err().to_string();
        assert!(e.starts_with("--boundary"), "{e}");
    }

    #[test]
    fn transfer_functions_are_checked() {
        let t = parse_transfer("points = [[0, 1, 0, 0, 0], [10.5, 0, 1, 0, 2]]", 512.0).unwrap();
        assert_eq!((t.points.len(), t.unit, t.points[1].2), (2, 2.0, 2.0));
        assert_eq!(
            parse_transfer("unit = 3.0\npoints = [[0, 1, 0, 0, 0]]", 512.0).unwrap().unit,
            3.0
        );
        for bad in [
            "",
            "points = []",
            "points = [[0, 1, 0, 0]]",
            "points = [[0, 1, 0, 0, -1]]",
            "points = [[0, 2, 0, 0, 1]]",
            "points = [[1, 1, 0, 0, 1], [1, 1, 0, 0, 1]]",
            "points = [[nan, 1, 0, 0, 1]]",
            "points = [[0, 1, 0, 0, 1]]\nunit = 0.0",
            "points = [[0, 1, 0, 0, 1]]\nunits = 1.0",
            "points = [[0, 1, 0, 0, 1, 7]]",
            "points = [[0, 1, 0, 0, 1]]\nunit = 1e-320",
            "points = [[0, 1, 0, 0, 1e38]]",
            "points = [[0, 1, 0, 0, 1]]\nunit = 1e-30",
            "points = [[",
        ] {
            let e = parse_transfer(bad, 512.0).unwrap_err().to_string();
            assert!(!e.contains('\n'), "{bad}: {e}");
        }
    }
}
