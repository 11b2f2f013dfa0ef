//! The five verbs: each takes its flags and returns an answer; nothing here prints.

pub mod check;
pub mod compare;
pub mod info;
pub mod methods;
pub mod render;

use crate::cli::{DataFlags, DrawFlags};
use crate::source::{self, Source};
use crate::{progress, settings, view_spec};
use anyhow::{Result, ensure};
use isobar_core::{Channels, Data, Knobs, Request, Sampling, Stop, Surface};
use std::path::Path;
use std::time::Instant;

/// Opens DATA as the flags say; the seconds it took come second.
///
/// # Errors
/// As [`source::open`]; also for an unusable `--nan`.
pub fn open(flags: &DataFlags) -> Result<(Source, f64)> {
    let nan = flags.nan.as_deref().map(|s| view_spec::number("--nan", s)).transpose()?;
    let options = isobar_io::Options {
        field: flags.field.clone(),
        nan,
        cell_to_point: flags.cell_to_point,
        as_hexes: false,
    };
    let start = Instant::now();
    let mut source = progress::watch(&format!("reading {}", flags.data), &Stop::default(), || {
        source::open(&flags.data, &options)
    })?;
    if flags.cell_to_point && !matches!(*source.data, Data::Tets(_)) {
        let kind = source.data.kind();
        let note = format!(
            "--cell-to-point changes nothing of {}: only values of tetrahedra are averaged, these are {kind}",
            source.name
        );
        source.notes.push(note);
    }
    Ok((source, start.elapsed().as_secs_f64()))
}

/// The files read, each with its flag, so that no output replaces one. What a header names beside it is not known yet.
#[must_use]
pub fn inputs<'a>(data: &'a DataFlags, tf: Option<&'a Path>, mesh: Option<&'a Path>) -> Vec<(&'static str, &'a Path)> {
    let data = source::path(&data.data).map(|p| ("DATA", p));
    [data, tf.map(|p| ("--tf", p)), mesh.map(|p| ("--mesh", p))]
        .into_iter()
        .flatten()
        .collect()
}

/// The request of these flags.
///
/// # Errors
/// When the number of layers or threads is unusable.
pub fn request(flags: &DrawFlags, knobs: Knobs, channels: Channels, layers: usize) -> Result<Request> {
    ensure!(
        (1..=65_535).contains(&layers),
        "--layers {layers}: give a number from 1 to 65535"
    );
    ensure!(
        flags.threads <= 4096,
        "--threads {}: more than 4096; leave it out for as many as the machine has",
        flags.threads
    );
    Ok(Request {
        channels,
        layers,
        sampling: Sampling::PixelCentre,
        threads: flags.threads,
        knobs,
    })
}

/// Warnings: the source's notes, and isovalues outside the range of the samples.
#[must_use]
pub fn warnings(source: &Source, surfaces: &[Surface]) -> Vec<String> {
    let mut out: Vec<String> = source.notes.clone();
    let range = match &*source.data {
        Data::Grid(g) => g.samples.range().0,
        Data::Algebraic(_) => None,
        _ => source.summary().range,
    };
    if let Some((lo, hi)) = range {
        for c in surfaces.iter().filter_map(Surface::value).filter(|c| *c < lo || *c > hi) {
            out.push(format!(
                "--isovalue {c} lies outside the values {} to {} of {}; that surface is empty{}",
                settings::short(lo),
                settings::short(hi),
                source.name,
                // Such coefficients are larger and smaller than the samples, and so is the function between these.
                if matches!(*source.data, Data::Grid(_)) {
                    " unless the reconstruction overshoots the samples (-interpolating, -prefiltered)"
                } else {
                    ""
                }
            ));
        }
    }
    out
}
