//! OFF (Geomview object file format), text: `OFF`, also with colours or normals at the points (`COFF`, `NOFF`, ...), which are ignored.
//!
//! Format: Geomview manual, "OFF files", <http://www.geomview.org/docs/html/OFF.html>. No well-kept crate was found for this page of text.
//! A point or a face is a line; comments from `#` and blank lines are skipped. Homogeneous (`4OFF`), n-dimensional (`nOFF`) and binary files are
//! refused.

use crate::error::{Cause, quoted};
use crate::input::{Input, line};
use crate::mesh::{TriangleMesh, point};

const FORMAT: &str = "OFF file";
/// A face of thousands of corners still fits.
const MOST_LINE: usize = 1 << 20;

/// Reads an OFF file.
pub(crate) fn read(input: &dyn Input) -> Result<TriangleMesh, Cause> {
    let mut reader = input.open(0)?;
    let mut read = 0;
    let mut next = || -> Result<Option<String>, Cause> {
        while let Some(text) = line(&mut *reader, MOST_LINE, &mut read, FORMAT)? {
            let useful = text.split('#').next().unwrap_or_default().trim();
            if !useful.is_empty() {
                return Ok(Some(useful.to_owned()));
            }
        }
        Ok(None)
    };
    let cut = |what: &str| Cause::malformed(FORMAT, format!("it ends before {what}"));

    let first = next()?.ok_or_else(|| cut("its first line"))?;
    let mut words = first.split_whitespace();
    let magic = words.next().unwrap_or_default();
    if !matches!(magic, "OFF" | "COFF" | "NOFF" | "CNOFF" | "STOFF" | "STCOFF" | "STNOFF") {
        return Err(Cause::Unsupported {
            format: "OFF",
            what: format!("magic {}", quoted(magic)),
            remedy: "write it as text with three coordinates for each point (OFF)",
        });
    }
    let mut counts: Vec<String> = words.map(str::to_owned).collect();
    if counts.first().is_some_and(|w| w == "BINARY") {
        return Err(Cause::Unsupported {
            format: "OFF",
            what: "binary data".into(),
            remedy: "write it as text",
        });
    }
    if counts.is_empty() {
        let text = next()?.ok_or_else(|| cut("its counts"))?;
        counts = text.split_whitespace().map(str::to_owned).collect();
    }
    let count = |i: usize| {
        counts.get(i).and_then(|w| w.parse::<u64>().ok()).ok_or_else(|| {
            Cause::malformed(
                FORMAT,
                format!("{} are not the counts of points and faces", quoted(&counts.join(" "))),
            )
        })
    };
    let (points, faces) = (count(0)?, count(1)?);
    // A point takes at least "0 0 0" and its end, a face "1 0".
    let need = points
        .saturating_mul(6)
        .saturating_add(faces.saturating_mul(4))
        .saturating_sub(1);
    if need > input.len() || points > u64::from(u32::MAX) {
        return Err(Cause::TooShort {
            declared: need,
            possible: input.len(),
        });
    }

    let mut mesh = TriangleMesh::default();
    for _ in 0..points {
        let text = next()?.ok_or_else(|| cut("its last point"))?;
        let mut words = text.split_whitespace();
        let mut word = || words.next().unwrap_or_default();
        mesh.points.push(point([word(), word(), word()], FORMAT)?);
    }
    let mut corners: Vec<u32> = Vec::new();
    for _ in 0..faces {
        let text = next()?.ok_or_else(|| cut("its last face"))?;
        let mut words = text.split_whitespace();
        let n: usize = words.next().and_then(|w| w.parse().ok()).unwrap_or(0);
        corners.clear();
        // What follows the corners is a colour.
        corners.extend(words.take(n).map_while(|w| w.parse::<u32>().ok()));
        if n == 0 || corners.len() != n {
            return Err(Cause::malformed(FORMAT, format!("{} is not a face", quoted(&text))));
        }
        mesh.polygon(&corners, FORMAT)?;
    }
    Ok(mesh)
}
