//! Views by name and by flags, as the command line gives them.

use anyhow::{Result, anyhow, bail, ensure};
use clap::{ArgMatches, Args};
use glam::DVec3;
use isobar_core::{Camera, ClipPlane, View};

/// Image size where `--size` is not given: that of the bench view.
pub const DEFAULT_SIZE: &str = "1024x768";
/// Vertical field of view where `--fov` is not given, degrees.
pub const DEFAULT_FOV: f64 = 40.0;
/// The names `--view` knows.
pub const NAMES: [&str; 8] = ["default", "bench", "+x", "-x", "+y", "-y", "+z", "-z"];

/// The flags that make a view.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "View")]
pub struct ViewFlags {
    /// Image size in pixels [default: 1024x768; of the views of check --rays 32x24]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    pub size: Option<String>,
    /// A named view: default (fits the data), bench, or from a side: +x -x +y -y +z -z
    #[arg(long, value_name = "NAME", allow_hyphen_values = true, conflicts_with_all = ["eye", "target", "up"])]
    pub view: Option<String>,
    /// World position of the eye
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub eye: Option<String>,
    /// World point in the middle of the image [default: the middle of the data]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "eye")]
    pub target: Option<String>,
    /// Upward direction [default: 0,0,1]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "eye")]
    pub up: Option<String>,
    /// Vertical field of view in degrees [default: 40]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, conflicts_with = "ortho")]
    pub fov: Option<String>,
    /// Orthographic: world height of the image; rays start on the plane through the eye
    #[arg(long, value_name = "HEIGHT", allow_hyphen_values = true)]
    pub ortho: Option<String>,
    /// Keep the half space nx*x + ny*y + nz*z <= d; may be repeated
    #[arg(long, value_name = "NX,NY,NZ,D", allow_hyphen_values = true)]
    pub clip: Vec<String>,
    /// Close the cut made by the --clip before it
    #[arg(long, num_args = 0, default_missing_value = "true", action = clap::ArgAction::Append)]
    pub cap: Vec<bool>,
    /// Positions of --cap among the arguments; filled by [`ViewFlags::place_caps`].
    #[arg(skip)]
    capped: Vec<bool>,
    #[arg(skip)]
    stray_cap: bool,
}

impl ViewFlags {
    /// Gives each `--cap` to the `--clip` before it; `matches` are those of the verb.
    pub fn place_caps(&mut self, matches: &ArgMatches) {
        let at = |id: &str| matches.indices_of(id).map(|i| i.collect::<Vec<_>>()).unwrap_or_default();
        let (clips, caps) = (at("clip"), at("cap"));
        self.capped = vec![false; self.clip.len()];
        if self.cap.is_empty() {
            return;
        }
        for cap in caps {
            match clips.iter().rposition(|&c| c < cap) {
                Some(i) if i < self.capped.len() => self.capped[i] = true,
                _ => self.stray_cap = true,
            }
        }
    }

    /// The image size, width and height.
    ///
    /// # Errors
    /// When `--size` is not two whole numbers above 0.
    pub fn pixels(&self) -> Result<(usize, usize)> {
        parse_size(self.size.as_deref().unwrap_or(DEFAULT_SIZE))
    }

    /// Checks everything that does not need the data.
    ///
    /// # Errors
    /// As [`ViewFlags::view`].
    pub fn validate(&self) -> Result<()> {
        self.view((DVec3::NEG_ONE, DVec3::ONE)).map(|_| ()).or_else(|e| {
            // The eye may coincide with a target that is only known with the data.
            if self.eye.is_some() && self.target.is_none() && e.to_string().contains("middle of the data") {
                Ok(())
            } else {
                Err(e)
            }
        })
    }

    /// Refuses `--cap`, for verbs that need the certified truth: a closed cut is no root of the function.
    ///
    /// # Errors
    /// When there is one.
    pub fn require_open_cuts(&self) -> Result<()> {
        ensure!(
            self.cap.is_empty(),
            "--cap: a closed cut is no root, so the oracle has nothing to say about it; leave out --cap"
        );
        Ok(())
    }

    /// The view these flags mean for data of these world bounds `(min, max)`.
    ///
    /// # Errors
    /// When a flag cannot be read, a number is out of range, or the view has no pixels or direction; the text names the flag.
    pub fn view(&self, bounds: (DVec3, DVec3)) -> Result<View> {
        let (width, height) = self.pixels()?;
        let fov = self.fov.as_deref().map(|s| number("--fov", s)).transpose()?;
        ensure!(
            fov.is_none_or(|f| f > 0.0 && f < 180.0),
            "--fov {}: must lie between 0 and 180 degrees; leave it out for {DEFAULT_FOV}",
            self.fov.as_deref().unwrap_or_default()
        );
        let fov = fov.unwrap_or(DEFAULT_FOV);
        let mut view = match &self.eye {
            Some(eye) => View::perspective(
                vector("--eye", eye)?,
                self.target
                    .as_deref()
                    .map_or(Ok((bounds.0 + bounds.1) * 0.5), |s| vector("--target", s))?,
                self.up.as_deref().map_or(Ok(DVec3::Z), |s| vector("--up", s))?,
                fov,
                width,
                height,
            ),
            None => named(self.view.as_deref().unwrap_or("default"), bounds, fov, width, height)?,
        };
        if let Some(h) = &self.ortho {
            let value = number("--ortho", h)?;
            ensure!(
                value > 0.0,
                "--ortho {h}: the image's height must be above 0; give it in world units"
            );
            view = orthographic(view, value);
        }
        ensure!(
            !self.stray_cap,
            "--cap: it belongs to the --clip before it, and there is none; put it after a --clip"
        );
        for (i, c) in self.clip.iter().enumerate() {
            let [x, y, z, distance] = numbers::<4>("--clip", c)?;
            let normal = DVec3::new(x, y, z);
            ensure!(
                normal != DVec3::ZERO,
                "--clip {c}: the normal is zero; give nx,ny,nz,d with a direction"
            );
            view.clips.push(ClipPlane {
                normal,
                distance,
                cap: self.capped.get(i).copied().unwrap_or(false),
            });
        }
        view.validate().map_err(|e| self.explain(e.into(), bounds))?;
        Ok(view)
    }

    /// An unusable camera, said of the flags that were given: eye and target may have been worked out.
    fn explain(&self, e: anyhow::Error, (lo, hi): (DVec3, DVec3)) -> anyhow::Error {
        let of_camera = e.to_string().contains("--eye") || e.to_string().contains("--up");
        match (&self.eye, &self.fov) {
            (None, Some(fov)) if of_camera => {
                anyhow!(
                    "--fov {fov}: data from {lo} to {hi} cannot be fitted into this angle; give a larger one, or --eye and --target"
                )
            }
            (None, None) if of_camera => anyhow!(
                "--view {}: the data, from {lo} to {hi}, are too small, too large or too far away to be looked at; scale them",
                self.view.as_deref().unwrap_or("default")
            ),
            (Some(eye), _) if of_camera && self.target.is_none() && e.to_string().contains("same point") => {
                anyhow!("--eye {eye}: it is the middle of the data, or too far from it; give another, or --target")
            }
            _ => e,
        }
    }
}

/// The same view with parallel rays and an image of this world height.
#[must_use]
pub fn orthographic(mut view: View, height: f64) -> View {
    if let Camera::Perspective { eye, target, up, .. } = view.camera {
        view.camera = Camera::Orthographic { eye, target, up, height };
    }
    view
}

/// One of the [`NAMES`]: `bench` is the contract's fixed view, the others fit the bounds `(min, max)` into the field of view (degrees).
/// From above and below, up is +y, else +z.
///
/// # Errors
/// When there is no view of this name, or the bounds have no size.
pub fn named(name: &str, bounds: (DVec3, DVec3), fov: f64, width: usize, height: usize) -> Result<View> {
    let from = |side: DVec3, up: DVec3| View::fit_from(bounds, side, up, fov, width, height);
    let view = match name {
        "bench" => View::perspective(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, DVec3::Z, fov, width, height),
        "default" => View::fit(bounds, fov, width, height),
        "+x" => from(DVec3::X, DVec3::Z),
        "-x" => from(DVec3::NEG_X, DVec3::Z),
        "+y" => from(DVec3::Y, DVec3::Z),
        "-y" => from(DVec3::NEG_Y, DVec3::Z),
        "+z" => from(DVec3::Z, DVec3::Y),
        "-z" => from(DVec3::NEG_Z, DVec3::Y),
        _ => bail!("--view {name}: no such view; use one of {}", NAMES.join(", ")),
    };
    if name != "bench" && bounds.0 == bounds.1 {
        bail!("--view {name}: the data are a single point, there is no size to fit; give --eye and --target");
    }
    Ok(view)
}

/// `WxH`.
///
/// # Errors
/// When it is not two whole numbers above 0.
pub fn parse_size(s: &str) -> Result<(usize, usize)> {
    let parts = s
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    let Some((width, height)) = parts else {
        bail!("--size {s}: not WIDTHxHEIGHT in whole pixels; write it like {DEFAULT_SIZE}");
    };
    ensure!(
        width > 0 && height > 0,
        "--size {s}: the image has no pixels; give both numbers above 0"
    );
    Ok((width, height))
}

/// A finite number given to `flag`.
///
/// # Errors
/// When it is none.
pub fn number(flag: &str, s: &str) -> Result<f64> {
    match s.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => bail!("{flag} {s}: not a finite number; write it like 0.5 or -1e3"),
    }
}

/// N finite numbers separated by commas, given to `flag`.
///
/// # Errors
/// When they are not that.
pub fn numbers<const N: usize>(flag: &str, s: &str) -> Result<[f64; N]> {
    let values: Vec<f64> = s.split(',').filter_map(|v| number(flag, v).ok()).collect();
    match <[f64; N]>::try_from(values) {
        Ok(v) if s.split(',').count() == N => Ok(v),
        _ => bail!("{flag} {s}: not {N} finite numbers; write them with commas and no blanks"),
    }
}

fn vector(flag: &str, s: &str) -> Result<DVec3> {
    numbers::<3>(flag, s).map(DVec3::from_array)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: (DVec3, DVec3) = (DVec3::ZERO, DVec3::new(2.0, 4.0, 4.0));

    fn flags(f: impl FnOnce(&mut ViewFlags)) -> ViewFlags {
        let mut flags = ViewFlags::default();
        f(&mut flags);
        flags
    }

    #[test]
    fn the_default_view_is_the_contracts() {
        let v = ViewFlags::default().view(BOX).unwrap();
        let Camera::Perspective { eye, target, up, fov } = v.camera else {
            panic!("perspective")
        };
        assert_eq!(
            (target, up, fov, v.width, v.height),
            (DVec3::new(1.0, 2.0, 2.0), DVec3::Z, 40.0, 1024, 768)
        );
        let want = 3.0 / 20f64.to_radians().sin();
        assert!(((eye - target).length() - want).abs() < 1e-12);
        assert!((eye - target).normalize().dot(DVec3::new(2.6, 1.9, 2.2).normalize()) > 1.0 - 1e-15);
    }

    #[test]
    fn sides_and_bench_are_known() {
        for name in NAMES {
            let v = flags(|f| f.view = Some(name.into())).view(BOX).unwrap();
            v.validate().unwrap();
        }
        let v = flags(|f| f.view = Some("bench".into())).view(BOX).unwrap();
        assert_eq!(v, View::bench(1024, 768));
        let v = flags(|f| f.view = Some("-x".into())).view(BOX).unwrap();
        let Camera::Perspective { eye, target, .. } = v.camera else {
            panic!("perspective")
        };
        assert!(eye.x < target.x && eye.y == target.y);
        assert!(flags(|f| f.view = Some("front".into())).view(BOX).is_err());
    }

    #[test]
    fn ortho_keeps_the_eye() {
        let v = flags(|f| {
            f.eye = Some("0,-3,0".into());
            f.target = Some("0,0,0".into());
            f.ortho = Some("2.5".into());
        })
        .view(BOX)
        .unwrap();
        assert_eq!(
            v.camera,
            Camera::Orthographic {
                eye: DVec3::new(0.0, -3.0, 0.0),
                target: DVec3::ZERO,
                up: DVec3::Z,
                height: 2.5
            }
        );
    }

    #[test]
    fn views_that_cannot_be_fitted_name_what_was_given() {
        let said = |f: ViewFlags, bounds| f.view(bounds).unwrap_err().to_string();
        let fov = flags(|f| f.fov = Some("1e-300".into()));
        assert!(said(fov, BOX).starts_with("--fov 1e-300"));
        for size in [1e-200, 1e308] {
            let e = said(ViewFlags::default(), (DVec3::ZERO, DVec3::splat(size)));
            assert!(e.starts_with("--view default") && !e.contains("--eye"), "{size}: {e}");
        }
        let eye = flags(|f| f.eye = Some("1,2,2".into()));
        assert!(said(eye, BOX).starts_with("--eye 1,2,2"));
        // Before the data are known, their middle is not.
        assert!(flags(|f| f.eye = Some("0,0,0".into())).validate().is_ok());
    }

    #[test]
    fn unusable_flags_name_themselves() {
        type Change = fn(&mut ViewFlags);
        let cases: [(&str, Change); 9] = [
            ("--size", |f| f.size = Some("0x10".into())),
            ("--size", |f| f.size = Some("10".into())),
            ("--size", |f| f.size = Some("-1x5".into())),
            ("--fov", |f| f.fov = Some("180".into())),
            ("--fov", |f| f.fov = Some("nan".into())),
            ("--ortho", |f| f.ortho = Some("0".into())),
            ("--eye", |f| f.eye = Some("1,2".into())),
            ("--clip", |f| f.clip = vec!["0,0,0,1".into()]),
            ("--up", |f| {
                f.eye = Some("0,0,5".into());
                f.target = Some("0,0,0".into());
            }),
        ];
        for (name, change) in cases {
            let e = flags(change).view(BOX).unwrap_err().to_string();
            assert!(e.contains(name) && !e.contains('\n'), "{name}: {e}");
        }
    }
}
