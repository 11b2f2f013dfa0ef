//! Q_active and the 24 lists T_active, on the device (Kalbe et al. 2009, section 4.1; K8 to K10).
//!
//! On a change of the isovalue: cubes are classified, scanned and compacted chunk by chunk, then the tetrahedra of the active ones are, 24 at a time, and the arguments of
//! 24 indirect draws are left behind. What is drawn never waits for the CPU to know how many there are; the two numbers of a part come back once per
//! change, only to see whether its lists were too short. Lists that outgrow one binding are halved: a part is a range of cubes with lists of its own.

use super::layout::{Level, Params};
use super::programs::ListKernels;
use isobar_gpu::{Gpu, GpuError, Volume, wgpu};
use std::ops::Range;
use std::time::Duration;

/// What lists may grow to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Limits {
    /// Cubes classified at once.
    pub(super) chunk: u32,
    /// Bytes of one list.
    pub(super) list: u64,
}

impl Limits {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self {
            chunk: 1 << 20,
            list: gpu.binding_limit(),
        }
    }
}

/// Cubes of a workgroup, workgroups of a row.
const BLOCK: u32 = 256;
const ROW: u32 = 256;

/// Bytes of a stored determining set.
const SET_BYTES: u64 = 4 * super::generate::SET as u64;

/// Workgroups for `n` cubes.
fn groups(n: u32) -> [u32; 3] {
    let blocks = n.div_ceil(BLOCK);
    [blocks.clamp(1, ROW), blocks.div_ceil(ROW).max(1), 1]
}

/// What is drawn: data, isovalues and settings of the lists.
#[derive(Debug, Clone, Copy)]
pub(super) struct Subject<'a> {
    pub(super) volume: &'a Volume,
    pub(super) levels: &'a wgpu::Buffer,
    /// Dimensions, number of isovalues and bias; the rest is filled in here.
    pub(super) params: Params,
    /// Determining sets are stored.
    pub(super) stored: bool,
}

/// A range of cubes and its lists.
#[derive(Debug)]
pub(super) struct Part {
    range: Range<u32>,
    room_cubes: u32,
    room_tets: u32,
    /// Indirect dispatch over active cubes, and their number.
    state: wgpu::Buffer,
    pub(super) cubes: wgpu::Buffer,
    masks: wgpu::Buffer,
    totals: wgpu::Buffer,
    pub(super) bases: wgpu::Buffer,
    pub(super) draws: wgpu::Buffer,
    pub(super) tetrahedra: wgpu::Buffer,
    pub(super) sets: Option<wgpu::Buffer>,
    /// Active cubes and tetrahedra.
    pub(super) counts: [u32; 2],
    /// What of it the view may see.
    culled: Option<Culled>,
}

/// The tetrahedra of a part that the view frustum may hold: as in [`Part`].
#[derive(Debug)]
struct Culled {
    masks: wgpu::Buffer,
    totals: wgpu::Buffer,
    bases: wgpu::Buffer,
    draws: wgpu::Buffer,
    tetrahedra: wgpu::Buffer,
    /// They are those of the view set.
    current: bool,
}

/// What a part is drawn from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawn<'a> {
    pub(super) bases: &'a wgpu::Buffer,
    pub(super) draws: &'a wgpu::Buffer,
    pub(super) tetrahedra: &'a wgpu::Buffer,
}

impl Part {
    fn new(gpu: &Gpu, range: Range<u32>, room_cubes: u32, room_tets: u32, stored: bool) -> Result<Self, GpuError> {
        let words = |what: &str, n: u64| gpu.storage_empty(what, 4 * n);
        let (cubes, tets) = (u64::from(room_cubes), u64::from(room_tets));
        Ok(Self {
            range,
            room_cubes,
            room_tets,
            state: gpu.indirect_empty("state of the lists", 16)?,
            cubes: words("active cubes", cubes)?,
            masks: words("kinds of active cubes", cubes)?,
            totals: words("tetrahedra by block", 24 * cubes.div_ceil(u64::from(BLOCK)))?,
            bases: words("beginnings of lists", 25)?,
            draws: gpu.indirect_empty("draw arguments", 24 * 16)?,
            tetrahedra: words("active tetrahedra", tets)?,
            sets: stored
                .then(|| gpu.storage_empty("determining sets", cubes * SET_BYTES))
                .transpose()?,
            counts: [0; 2],
            culled: None,
        })
    }

    fn bytes(&self) -> u64 {
        let all = [
            &self.state,
            &self.cubes,
            &self.masks,
            &self.totals,
            &self.bases,
            &self.draws,
            &self.tetrahedra,
        ];
        let culled = self
            .culled
            .iter()
            .flat_map(|c| [&c.masks, &c.totals, &c.bases, &c.draws, &c.tetrahedra]);
        all.into_iter().chain(culled).map(wgpu::Buffer::size).sum::<u64>() + self.sets.as_ref().map_or(0, wgpu::Buffer::size)
    }

    /// The active tetrahedra to draw: those that the view may see, where they were culled.
    pub(super) fn drawn(&self) -> Drawn<'_> {
        match self.culled.as_ref().filter(|c| c.current) {
            Some(c) => Drawn {
                bases: &c.bases,
                draws: &c.draws,
                tetrahedra: &c.tetrahedra,
            },
            None => Drawn {
                bases: &self.bases,
                draws: &self.draws,
                tetrahedra: &self.tetrahedra,
            },
        }
    }

    /// Room for what the view sees of it.
    fn make_room(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.culled.is_none() {
            let words = |what: &str, like: &wgpu::Buffer| gpu.storage_empty(what, like.size());
            self.culled = Some(Culled {
                masks: words("kinds of visible cubes", &self.masks)?,
                totals: words("visible tetrahedra by block", &self.totals)?,
                bases: words("beginnings of visible lists", &self.bases)?,
                draws: gpu.indirect_empty("visible draw arguments", 24 * 16)?,
                tetrahedra: words("visible tetrahedra", &self.tetrahedra)?,
                current: false,
            });
        }
        Ok(())
    }

    fn params(&self, subject: &Subject<'_>) -> Params {
        Params {
            room_cubes: self.room_cubes,
            room_tets: self.room_tets,
            slots: u32::from(subject.stored),
            blocks: self.room_cubes.div_ceil(BLOCK),
            ..subject.params
        }
    }

    /// Bytes that the lists of what is active need: Q_active, T_active, stored determining sets.
    fn used(&self) -> [u64; 3] {
        let [cubes, tets] = self.counts.map(u64::from);
        [4 * cubes, 4 * tets, if self.sets.is_some() { SET_BYTES * cubes } else { 0 }]
    }
}

/// What a chunk of cubes needs while it is classified.
#[derive(Debug)]
struct Scratch {
    flags: wgpu::Buffer,
    scan: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// Least and greatest datum around 256 cubes each; of the data at hand, once `ranged` is set.
    ranges: wgpu::Buffer,
    ranged: bool,
}

/// The lists of a volume.
#[derive(Debug)]
pub(super) struct Lists {
    limits: Limits,
    scratch: Scratch,
    pub(super) parts: Vec<Part>,
    /// Device time of the last change: cubes, tetrahedra.
    pub(super) times: Option<[Duration; 2]>,
}

/// What the two numbers of a part say.
enum Outcome {
    Fits,
    Grow { cubes: u32, tets: u32 },
    Split,
}

impl Lists {
    /// Empty lists for `cubes` cubes.
    pub(super) fn new(gpu: &Gpu, cubes: u32, limits: Limits, stored: bool) -> Result<Self, GpuError> {
        let chunk = u64::from(limits.chunk.min(cubes.max(1)));
        let mut new = Self {
            scratch: Scratch {
                flags: gpu.storage_empty("flags of cubes", 4 * chunk)?,
                scan: gpu.storage_empty("scan of flags", 4 * chunk)?,
                sums: gpu.storage_empty("sums of blocks", 4 * chunk.div_ceil(u64::from(BLOCK)))?,
                ranges: gpu.storage_empty("ranges of blocks", 8 * u64::from(cubes.max(1).div_ceil(BLOCK)))?,
                ranged: false,
            },
            limits,
            parts: Vec::new(),
            times: None,
        };
        new.parts.push(new.part(gpu, 0..cubes, stored)?);
        Ok(new)
    }

    /// Most active cubes and tetrahedra that one part's lists can hold.
    fn most(&self, stored: bool) -> [u32; 2] {
        let fit = |bytes: u64| u32::try_from(self.limits.list / bytes).unwrap_or(u32::MAX);
        [if stored { fit(SET_BYTES) } else { fit(4) }, fit(4)]
    }

    fn part(&self, gpu: &Gpu, range: Range<u32>, stored: bool) -> Result<Part, GpuError> {
        let [cubes, tets] = self.most(stored);
        let room = (range.len() as u32 / 16).clamp(256, 1 << 20).min(cubes);
        Part::new(gpu, range, room, room.saturating_mul(8).min(tets), stored)
    }

    /// The data are others, of the same size.
    pub(super) fn forget_data(&mut self) {
        self.scratch.ranged = false;
    }

    /// The least and greatest datum of all blocks, where the data are new.
    fn range(&mut self, gpu: &Gpu, kernels: &ListKernels, subject: &Subject<'_>) -> Result<(), GpuError> {
        if self.scratch.ranged {
            return Ok(());
        }
        let count = subject.params.dims.iter().product();
        let params = Params {
            count,
            bias: [0.0; 2],
            ..subject.params
        };
        let uniform = gpu.uniform("parameters", &params)?;
        let bind = kernels.ranges.bind(
            gpu,
            &[
                (0, wgpu::BindingResource::TextureView(subject.volume.view())),
                (1, uniform.as_entire_binding()),
                (3, self.scratch.ranges.as_entire_binding()),
            ],
        )?;
        gpu.run("ranges of blocks", 1, |w| w.compute(&kernels.ranges, &bind, groups(count)))?;
        self.scratch.ranged = true;
        Ok(())
    }

    /// Leaves out of every part what the frustum does not hold; all is drawn without planes. No number comes back.
    pub(super) fn cull(
        &mut self,
        gpu: &Gpu,
        kernels: &ListKernels,
        subject: &Subject<'_>,
        planes: Option<&super::cull::Planes>,
    ) -> Result<(), GpuError> {
        for part in &mut self.parts {
            if let Some(c) = &mut part.culled {
                c.current = false;
            }
            let Some(planes) = planes else { continue };
            part.make_room(gpu)?;
            let params = part.params(subject);
            let (uniform, frustum) = (gpu.uniform("parameters", &params)?, gpu.storage("frustum", planes)?);
            let Some(c) = &part.culled else { continue };
            let bind = kernels.cull.bind(
                gpu,
                &[
                    (1, uniform.as_entire_binding()),
                    (2, frustum.as_entire_binding()),
                    (3, part.state.as_entire_binding()),
                    (4, part.cubes.as_entire_binding()),
                    (5, part.masks.as_entire_binding()),
                    (6, c.totals.as_entire_binding()),
                    (7, c.masks.as_entire_binding()),
                ],
            )?;
            let to = [&c.masks, &c.totals, &c.bases, &c.draws, &c.tetrahedra];
            let [offsets, arguments, lists] = bind_lists(gpu, kernels, part, &uniform, to)?;
            gpu.run("culling", 4, |w| {
                w.compute_indirect(&kernels.cull, &bind, &part.state, 0);
                w.compute(&kernels.offsets, &offsets, [24, 1, 1]);
                w.compute(&kernels.arguments, &arguments, [1, 1, 1]);
                w.compute_indirect(&kernels.lists, &lists, &part.state, 0);
            })?;
            if let Some(c) = &mut part.culled {
                c.current = true;
            }
        }
        Ok(())
    }

    /// Finds everything active anew.
    pub(super) fn rebuild(&mut self, gpu: &Gpu, kernels: &ListKernels, subject: &Subject<'_>) -> Result<(), GpuError> {
        let mut total: Option<[Duration; 2]> = gpu.report().timestamps.then_some([Duration::ZERO; 2]);
        self.range(gpu, kernels, subject)?;
        let mut at = 0;
        while at < self.parts.len() {
            let (outcome, times) = self.build(gpu, kernels, subject, at)?;
            // What had to be done twice counts twice.
            total = total.zip(times).map(|(a, b)| [a[0] + b[0], a[1] + b[1]]);
            let stored = subject.stored;
            let range = self.parts[at].range.clone();
            match outcome {
                Outcome::Fits => at += 1,
                Outcome::Grow { cubes, tets } => self.parts[at] = Part::new(gpu, range, cubes, tets, stored)?,
                Outcome::Split => {
                    let middle = range.start + range.len() as u32 / 2;
                    self.parts[at] = self.part(gpu, range.start..middle, stored)?;
                    let second = self.part(gpu, middle..range.end, stored)?;
                    self.parts.insert(at + 1, second);
                }
            }
        }
        self.times = total;
        Ok(())
    }

    /// One part; what its numbers say, and the device times.
    fn build(
        &mut self,
        gpu: &Gpu,
        kernels: &ListKernels,
        subject: &Subject<'_>,
        at: usize,
    ) -> Result<(Outcome, Option<[Duration; 2]>), GpuError> {
        let part = &self.parts[at];
        let params = part.params(subject);
        let mut chunks = Vec::new();
        for first in part.range.clone().step_by(self.limits.chunk as usize) {
            let count = self.limits.chunk.min(part.range.end - first);
            chunks.push((
                count,
                self.bind_chunk(gpu, kernels, subject, part, &Params { first, count, ..params })?,
            ));
        }
        let rest = bind_rest(gpu, kernels, subject, part, &params)?;
        let timed = 4 * chunks.len() as u32 + 5;
        let times = gpu.run("active tetrahedra", timed, |w| {
            w.encoder().clear_buffer(&part.state, 0, None);
            for (count, [classify, scan, sums, compact]) in &chunks {
                w.compute(&kernels.classify, classify, groups(*count));
                w.compute(&kernels.scan, scan, groups(*count));
                w.compute(&kernels.sums, sums, [1, 1, 1]);
                w.compute(&kernels.compact, compact, groups(*count));
            }
            w.compute_indirect(&kernels.tetrahedra, &rest.tetrahedra, &part.state, 0);
            w.compute(&kernels.offsets, &rest.offsets, [24, 1, 1]);
            w.compute(&kernels.arguments, &rest.arguments, [1, 1, 1]);
            w.compute_indirect(&kernels.lists, &rest.lists, &part.state, 0);
            if let Some(sets) = &rest.sets {
                w.compute_indirect(&kernels.sets, sets, &part.state, 0);
            }
        })?;
        let times = times.map(|t| {
            let (cubes, tets) = t.split_at((4 * chunks.len()).min(t.len()));
            [cubes.iter().sum(), tets.iter().sum()]
        });
        let state: Vec<u32> = gpu.read(&part.state, 4)?;
        let bases: Vec<u32> = gpu.read(&part.bases, 25)?;
        let (cubes, tets) = (state[3], bases[24]);
        let [most_cubes, most_tets] = self.most(subject.stored);
        let part = &mut self.parts[at];
        let outcome = if cubes <= part.room_cubes && tets <= part.room_tets {
            part.counts = [cubes, tets];
            Outcome::Fits
        } else if (cubes > most_cubes || tets > most_tets) && part.range.len() > 1 {
            Outcome::Split
        } else {
            // Where cubes were dropped the tetrahedra are not all counted yet.
            let more = |n: u32, room: u32, most: u32| if n > room { n.saturating_add(n / 8).min(most) } else { room };
            let room = more(cubes, part.room_cubes, most_cubes);
            Outcome::Grow {
                cubes: room,
                tets: more(tets, part.room_tets, most_tets).max(room.saturating_mul(8).min(most_tets)),
            }
        };
        Ok((outcome, times))
    }

    fn bind_chunk(
        &self,
        gpu: &Gpu,
        kernels: &ListKernels,
        subject: &Subject<'_>,
        part: &Part,
        params: &Params,
    ) -> Result<[wgpu::BindGroup; 4], GpuError> {
        let uniform = gpu.uniform("parameters", params)?;
        let view = wgpu::BindingResource::TextureView(subject.volume.view());
        let (u, s) = (uniform.as_entire_binding(), &self.scratch);
        let (flags, scan, sums) = (
            s.flags.as_entire_binding(),
            s.scan.as_entire_binding(),
            s.sums.as_entire_binding(),
        );
        Ok([
            kernels.classify.bind(
                gpu,
                &[
                    (0, view),
                    (1, u.clone()),
                    (2, subject.levels.as_entire_binding()),
                    (3, flags.clone()),
                    (4, s.ranges.as_entire_binding()),
                ],
            )?,
            kernels.scan.bind(
                gpu,
                &[(1, u.clone()), (2, flags.clone()), (3, scan.clone()), (4, sums.clone())],
            )?,
            kernels
                .sums
                .bind(gpu, &[(1, u.clone()), (2, sums.clone()), (3, part.state.as_entire_binding())])?,
            kernels.compact.bind(
                gpu,
                &[(1, u), (2, flags), (3, scan), (4, sums), (5, part.cubes.as_entire_binding())],
            )?,
        ])
    }

    /// Active cubes and tetrahedra.
    pub(super) fn counts(&self) -> [u64; 2] {
        let sum = |i: usize| self.parts.iter().map(|p| u64::from(p.counts[i])).sum();
        [sum(0), sum(1)]
    }

    /// Device bytes held.
    pub(super) fn bytes(&self) -> u64 {
        let s = &self.scratch;
        s.flags.size() + s.scan.size() + s.sums.size() + s.ranges.size() + self.parts.iter().map(Part::bytes).sum::<u64>()
    }

    /// Bytes that what is active needs: Q_active, T_active, determining sets.
    pub(super) fn used(&self) -> [u64; 3] {
        self.parts.iter().map(Part::used).fold([0; 3], |a, b| {
            let [x, y, z] = a;
            [x + b[0], y + b[1], z + b[2]]
        })
    }
}

/// Resources of the kernels over active cubes.
struct Rest {
    tetrahedra: wgpu::BindGroup,
    offsets: wgpu::BindGroup,
    arguments: wgpu::BindGroup,
    lists: wgpu::BindGroup,
    sets: Option<wgpu::BindGroup>,
}

fn bind_rest(gpu: &Gpu, kernels: &ListKernels, subject: &Subject<'_>, part: &Part, params: &Params) -> Result<Rest, GpuError> {
    let uniform = gpu.uniform("parameters", params)?;
    let view = wgpu::BindingResource::TextureView(subject.volume.view());
    let u = uniform.as_entire_binding();
    let [state, cubes, masks, totals] =
        [&part.state, &part.cubes, &part.masks, &part.totals].map(wgpu::Buffer::as_entire_binding);
    let to = [&part.masks, &part.totals, &part.bases, &part.draws, &part.tetrahedra];
    let [offsets, arguments, lists] = bind_lists(gpu, kernels, part, &uniform, to)?;
    Ok(Rest {
        tetrahedra: kernels.tetrahedra.bind(
            gpu,
            &[
                (0, view.clone()),
                (1, u.clone()),
                (2, subject.levels.as_entire_binding()),
                (3, state.clone()),
                (4, cubes.clone()),
                (5, masks),
                (6, totals),
            ],
        )?,
        offsets,
        arguments,
        lists,
        sets: part
            .sets
            .as_ref()
            .map(|s| {
                let resources = [(0, view), (1, u), (3, state), (4, cubes), (5, s.as_entire_binding())];
                kernels.sets.bind(gpu, &resources)
            })
            .transpose()?,
    })
}

/// The resources of the scans, the draw arguments and the 24 compactions of a part, from masks and into totals, bases, draws and tetrahedra.
fn bind_lists(
    gpu: &Gpu,
    kernels: &ListKernels,
    part: &Part,
    uniform: &wgpu::Buffer,
    buffers: [&wgpu::Buffer; 5],
) -> Result<[wgpu::BindGroup; 3], GpuError> {
    let [masks, totals, bases, draws, tetrahedra] = buffers.map(wgpu::Buffer::as_entire_binding);
    let (u, state) = (uniform.as_entire_binding(), part.state.as_entire_binding());
    Ok([
        kernels.offsets.bind(
            gpu,
            &[(1, u.clone()), (2, state.clone()), (3, totals.clone()), (4, bases.clone())],
        )?,
        kernels
            .arguments
            .bind(gpu, &[(1, u.clone()), (2, bases.clone()), (3, draws)])?,
        kernels.lists.bind(
            gpu,
            &[
                (1, u),
                (2, state),
                (3, part.cubes.as_entire_binding()),
                (4, masks),
                (5, totals),
                (6, bases),
                (7, tetrahedra),
            ],
        )?,
    ])
}

/// The isovalues inside a range, ascending, times `scale`, less the bias, and the bias as a sum of two f32.
pub(super) fn levels(surfaces: &isobar_cpu::scene::Isovalues, range: (f64, f64), scale: f64) -> (Vec<Level>, [f32; 2]) {
    let within: Vec<(usize, f64)> = surfaces
        .values()
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, c)| range.0 <= *c && *c <= range.1)
        .map(|(i, c)| (i, c * scale))
        .collect();
    let bias = match (within.first(), within.last()) {
        (Some(a), Some(b)) => 0.5 * a.1 + 0.5 * b.1,
        _ => 0.0,
    };
    let hi = bias as f32;
    let lo = (bias - f64::from(hi)) as f32;
    let levels = within
        .into_iter()
        .map(|(i, c)| Level {
            value: (c - bias) as f32,
            surface: u32::from(surfaces.surface(i)),
        })
        .collect();
    (levels, [hi, lo])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_cover_everything() {
        for n in [0, 1, 256, 257, 65_536, 65_537, 1 << 20, u32::MAX] {
            let [x, y, _] = groups(n);
            assert!(
                u64::from(x) * u64::from(y) * u64::from(BLOCK) >= u64::from(n) && x <= ROW && y <= 65_536,
                "{n}"
            );
        }
    }
}
