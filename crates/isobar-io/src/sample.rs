//! From bytes or text to [`Samples`]: straight into the shared buffer, no second copy.
//!
//! A field of a native type (u8, i16, u16, f32) is read into its final `Arc` and its byte order put right in place. Other types, vector
//! components, magnitudes and scaled values go through a batch of [`BATCH`] values. Every size has been checked against the source by the
//! caller (`input::sized`) before a function here allocates.

use crate::error::{Cause, quoted};
use crate::input::fill;
use bytemuck::Pod;
use isobar_core::Samples;
use std::io::{BufRead, Read};
use std::sync::Arc;

/// Values converted at a time.
const BATCH: usize = 16 << 10;

/// The type of one value in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    /// Bytes of one value.
    pub(crate) const fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Name for messages.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::I8 => "int8",
            Self::U8 => "uint8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::I32 => "int32",
            Self::U32 => "uint32",
            Self::I64 => "int64",
            Self::U64 => "uint64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }
}

/// What is taken of each tuple.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pick {
    /// One component.
    Component(usize),
    /// The Euclidean length.
    Magnitude,
}

/// How samples lie in a source.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Layout {
    pub(crate) scalar: Scalar,
    pub(crate) big_endian: bool,
    /// Values per tuple, at least 1.
    pub(crate) components: usize,
    pub(crate) pick: Pick,
    /// Tuples.
    pub(crate) count: usize,
    /// Slope and intercept; the result is then f32.
    pub(crate) scale: Option<(f64, f64)>,
}

impl Layout {
    /// Bytes in the source; `None` where that overflows.
    pub(crate) fn bytes(&self) -> Option<u64> {
        (self.count as u64)
            .checked_mul(self.components as u64)?
            .checked_mul(self.scalar.bytes() as u64)
    }

    /// The type kept: the file's own where it is one of the four of [`Samples`] and nothing is computed, else f32.
    fn kept(&self) -> Scalar {
        let native = matches!(self.scalar, Scalar::U8 | Scalar::I16 | Scalar::U16 | Scalar::F32);
        if native && self.scale.is_none() && self.pick != Pick::Magnitude {
            self.scalar
        } else {
            Scalar::F32
        }
    }
}

/// Number of samples, positive and small enough to count in bytes of f64.
pub(crate) fn count(dims: [u64; 3]) -> Result<usize, Cause> {
    dims.iter()
        .try_fold(1u64, |n, &d| n.checked_mul(d))
        .filter(|&n| n > 0 && n <= (isize::MAX as u64) / 8)
        .and_then(|n| usize::try_from(n).ok())
        .ok_or(Cause::Dims(dims))
}

/// Reads `layout.count` tuples. A note is added where a conversion to f32 changed values.
pub(crate) fn read_binary(reader: &mut dyn Read, layout: &Layout, notes: &mut Vec<String>) -> Result<Samples, Cause> {
    if layout.components == 1 && layout.kept() == layout.scalar {
        return match layout.scalar {
            Scalar::U8 => read_native(reader, layout, |v: &mut u8| *v).map(Samples::U8),
            Scalar::I16 => read_native(reader, layout, |v: &mut i16| v.swap_bytes()).map(Samples::I16),
            Scalar::U16 => read_native(reader, layout, |v: &mut u16| v.swap_bytes()).map(Samples::U16),
            _ => read_native(reader, layout, |v: &mut f32| f32::from_bits(v.to_bits().swap_bytes())).map(Samples::F32),
        };
    }
    let size = layout.scalar.bytes();
    let declared = layout.bytes().ok_or(Cause::Dims([layout.count as u64, 1, 1]))?;
    let mut bytes = vec![0u8; batch_values(layout) * size];
    let mut found = 0u64;
    convert(layout, notes, &mut |out: &mut [f64]| {
        let part = &mut bytes[..out.len() * size];
        let n = fill(reader, part)?;
        found += n as u64;
        if n < part.len() {
            return Err(Cause::Truncated { declared, found });
        }
        Ok(decode(layout.scalar, layout.big_endian, part, out))
    })
}

/// Reads `layout.count` tuples of numbers separated by white space. A note is added where a conversion to f32 changed values.
pub(crate) fn read_text(reader: &mut dyn BufRead, layout: &Layout, notes: &mut Vec<String>) -> Result<Samples, Cause> {
    let mut word = Vec::new();
    let mut at = 0u64;
    convert(layout, notes, &mut |out: &mut [f64]| {
        let mut changed = 0;
        for v in out {
            if !next_word(reader, &mut word)? {
                let wanted = layout.count as u64 * layout.components as u64;
                return Err(Cause::malformed(
                    "text samples",
                    format!("they end after {at} of {wanted} numbers"),
                ));
            }
            let text = std::str::from_utf8(&word).unwrap_or("\u{fffd}");
            let (value, lost) = parse(text, layout.scalar)
                .ok_or_else(|| Cause::malformed("text samples", format!("{} is not a {}", quoted(text), layout.scalar.name())))?;
            *v = value;
            changed += usize::from(lost);
            at += 1;
        }
        Ok(changed)
    })
}

/// All `layout.count * layout.components` numbers of binary data as f64, nothing picked: for points and connectivity.
pub(crate) fn numbers_binary(reader: &mut dyn Read, layout: &Layout) -> Result<Vec<f64>, Cause> {
    let size = layout.scalar.bytes();
    let declared = layout.bytes().ok_or(Cause::Dims([layout.count as u64, 1, 1]))?;
    let mut out = reserved(layout)?;
    let mut bytes = vec![0u8; BATCH * size];
    let mut found = 0u64;
    for part in out.chunks_mut(BATCH) {
        let bytes = &mut bytes[..part.len() * size];
        let n = fill(reader, bytes)?;
        found += n as u64;
        if n < bytes.len() {
            return Err(Cause::Truncated { declared, found });
        }
        decode(layout.scalar, layout.big_endian, bytes, part);
    }
    Ok(out)
}

/// The same of text.
pub(crate) fn numbers_text(reader: &mut dyn BufRead, layout: &Layout) -> Result<Vec<f64>, Cause> {
    let mut out = reserved(layout)?;
    let mut word = Vec::new();
    for v in &mut out {
        let text = if next_word(reader, &mut word)? {
            std::str::from_utf8(&word).unwrap_or("\u{fffd}")
        } else {
            return Err(Cause::malformed("text", "an array of numbers ends early"));
        };
        (*v, _) = parse(text, layout.scalar)
            .ok_or_else(|| Cause::malformed("text", format!("{} is not a {}", quoted(text), layout.scalar.name())))?;
    }
    Ok(out)
}

/// Zeros for all numbers of a layout, or an error where the allocator refuses.
fn reserved(layout: &Layout) -> Result<Vec<f64>, Cause> {
    let n = layout
        .count
        .checked_mul(layout.components)
        .ok_or(Cause::Dims([layout.count as u64, layout.components as u64, 1]))?;
    let mut out = Vec::new();
    out.try_reserve_exact(n).map_err(|_| Cause::Memory(n as u64 * 8))?;
    out.resize(n, 0.0);
    Ok(out)
}

/// Checks that `text_bytes` of text can hold the samples: each needs a digit and, but for the last, a separator.
pub(crate) fn check_text(layout: &Layout, text_bytes: u64) -> Result<(), Cause> {
    let values = (layout.count as u64)
        .checked_mul(layout.components as u64)
        .ok_or(Cause::Dims([layout.count as u64, 1, 1]))?;
    let need = values.saturating_mul(2).saturating_sub(1);
    if need > text_bytes {
        return Err(Cause::TooShort {
            declared: need,
            possible: text_bytes,
        });
    }
    Ok(())
}

/// The next word between white space; false at the end.
pub(crate) fn next_word(reader: &mut dyn BufRead, word: &mut Vec<u8>) -> Result<bool, Cause> {
    /// No number is written with more characters than an exact f64.
    const LONGEST: usize = 1100;
    word.clear();
    loop {
        let buffer = reader.fill_buf().map_err(|e| Cause::system("read", &e))?;
        if buffer.is_empty() {
            return Ok(!word.is_empty());
        }
        let skip = if word.is_empty() {
            buffer.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(buffer.len())
        } else {
            0
        };
        let end = buffer[skip..].iter().position(u8::is_ascii_whitespace);
        let stop = end.map_or(buffer.len(), |e| skip + e);
        word.extend_from_slice(&buffer[skip..stop.min(skip + LONGEST)]);
        reader.consume(stop);
        if word.len() >= LONGEST {
            return Err(Cause::malformed(
                "text samples",
                format!("{} is not a number", quoted(&String::from_utf8_lossy(word))),
            ));
        }
        if end.is_some() && !word.is_empty() {
            return Ok(true);
        }
    }
}

/// Replaces NaN and infinite samples by `value`; how many. The buffer must not be shared yet.
pub(crate) fn replace_not_finite(samples: &mut Samples, value: f64) -> usize {
    let Samples::F32(s) = samples else { return 0 };
    let Some(s) = Arc::get_mut(s) else { return 0 };
    let mut n = 0;
    for v in s.iter_mut().filter(|v| !v.is_finite()) {
        *v = value as f32;
        n += 1;
    }
    n
}

/// A shared buffer of n zeros, one allocation; an error where the allocator refuses.
fn zeros<T: Pod>(n: usize) -> Result<Arc<[T]>, Cause> {
    let refused = || Cause::Memory(n as u64 * size_of::<T>() as u64);
    // An `Arc` cannot be tried: ask for the same with a `Vec` first, give it back untouched.
    Vec::<T>::new().try_reserve_exact(n).map_err(|_| refused())?;
    Ok(std::iter::repeat_n(T::zeroed(), n).collect())
}

fn read_native<T: Pod>(reader: &mut dyn Read, layout: &Layout, swapped: impl Fn(&mut T) -> T) -> Result<Arc<[T]>, Cause> {
    let mut samples = zeros::<T>(layout.count)?;
    let out = Arc::get_mut(&mut samples).expect("made here, not shared");
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(out);
    let found = fill(reader, bytes)?;
    if found < bytes.len() {
        return Err(Cause::Truncated {
            declared: bytes.len() as u64,
            found: found as u64,
        });
    }
    if layout.big_endian != cfg!(target_endian = "big") {
        for v in out {
            *v = swapped(v);
        }
    }
    Ok(samples)
}

/// Values in a batch: whole tuples, at least one.
fn batch_values(layout: &Layout) -> usize {
    (BATCH / layout.components).clamp(1, layout.count.max(1)) * layout.components
}

/// Pulls batches of values, picks and scales, and stores. `next` fills its argument and returns how many were lost in f64.
fn convert(
    layout: &Layout,
    notes: &mut Vec<String>,
    next: &mut dyn FnMut(&mut [f64]) -> Result<usize, Cause>,
) -> Result<Samples, Cause> {
    Ok(match layout.kept() {
        Scalar::U8 => Samples::U8(stored(layout, notes, next, |v| (v as u8, true))?),
        Scalar::I16 => Samples::I16(stored(layout, notes, next, |v| (v as i16, true))?),
        Scalar::U16 => Samples::U16(stored(layout, notes, next, |v| (v as u16, true))?),
        _ => {
            // A text float32 or a computed value is meant to be rounded; only a direct copy of a wider type loses something.
            let direct = layout.scale.is_none() && layout.pick != Pick::Magnitude && layout.scalar != Scalar::F32;
            Samples::F32(stored(layout, notes, next, |v| {
                let f = v as f32;
                let same = !direct || f64::from(f) == v || v.is_nan();
                (f, same)
            })?)
        }
    })
}

/// See [`convert`]; `narrow` gives the value stored and whether it is the same number.
fn stored<T: Pod>(
    layout: &Layout,
    notes: &mut Vec<String>,
    next: &mut dyn FnMut(&mut [f64]) -> Result<usize, Cause>,
    narrow: impl Fn(f64) -> (T, bool),
) -> Result<Arc<[T]>, Cause> {
    let mut samples = zeros::<T>(layout.count)?;
    let out = Arc::get_mut(&mut samples).expect("made here, not shared");
    let mut batch = vec![0.0; batch_values(layout)];
    let mut changed = 0usize;
    for part in out.chunks_mut(batch.len() / layout.components) {
        let values = &mut batch[..part.len() * layout.components];
        let lost = next(values)?;
        changed += if layout.components == 1 { lost } else { 0 };
        for (o, tuple) in part.iter_mut().zip(values.chunks_exact(layout.components)) {
            let v = match layout.pick {
                Pick::Component(c) => tuple[c],
                Pick::Magnitude => tuple.iter().map(|v| v * v).sum::<f64>().sqrt(),
            };
            let v = layout.scale.map_or(v, |(slope, inter)| v * slope + inter);
            let (value, same) = narrow(v);
            *o = value;
            changed += usize::from(!same);
        }
    }
    if changed > 0 && layout.scale.is_none() {
        notes.push(format!(
            "{changed} of {} {} samples changed by rounding to float32",
            layout.count,
            layout.scalar.name()
        ));
    }
    Ok(samples)
}

/// Whether going through f64 changes an integer in a way that the step from there to f32 will not notice.
fn lost_in_f64(v: i128) -> bool {
    let f = v as f64;
    f as i128 != v && f64::from(f as f32).to_bits() == f.to_bits()
}

/// Decodes values; how many were lost in f64 (see [`lost_in_f64`]).
fn decode(scalar: Scalar, big_endian: bool, bytes: &[u8], out: &mut [f64]) -> usize {
    /// `$t` per value, in the byte order asked.
    macro_rules! each {
        ($t:ty, $lost:expr) => {{
            let mut lost = 0;
            for (o, b) in out.iter_mut().zip(bytes.as_chunks::<{ size_of::<$t>() }>().0) {
                let v = if big_endian {
                    <$t>::from_be_bytes(*b)
                } else {
                    <$t>::from_le_bytes(*b)
                };
                *o = v as f64;
                let lossy: fn($t) -> bool = $lost;
                lost += usize::from(lossy(v));
            }
            lost
        }};
    }
    match scalar {
        Scalar::I8 => each!(i8, |_| false),
        Scalar::U8 => each!(u8, |_| false),
        Scalar::I16 => each!(i16, |_| false),
        Scalar::U16 => each!(u16, |_| false),
        Scalar::I32 => each!(i32, |_| false),
        Scalar::U32 => each!(u32, |_| false),
        Scalar::I64 => each!(i64, |v| lost_in_f64(i128::from(v))),
        Scalar::U64 => each!(u64, |v| lost_in_f64(i128::from(v))),
        Scalar::F32 => each!(f32, |_| false),
        Scalar::F64 => each!(f64, |_| false),
    }
}

/// A number of the type, as f64, and whether it was lost there (see [`lost_in_f64`]); `None` where it is not one.
fn parse(text: &str, scalar: Scalar) -> Option<(f64, bool)> {
    let integer = |lo: i128, hi: i128| {
        let v: i128 = text.parse().ok()?;
        (lo..=hi).contains(&v).then_some((v as f64, lost_in_f64(v)))
    };
    match scalar {
        Scalar::I8 => integer(i8::MIN.into(), i8::MAX.into()),
        Scalar::U8 => integer(0, u8::MAX.into()),
        Scalar::I16 => integer(i16::MIN.into(), i16::MAX.into()),
        Scalar::U16 => integer(0, u16::MAX.into()),
        Scalar::I32 => integer(i32::MIN.into(), i32::MAX.into()),
        Scalar::U32 => integer(0, u32::MAX.into()),
        Scalar::I64 => integer(i64::MIN.into(), i64::MAX.into()),
        Scalar::U64 => integer(0, u64::MAX.into()),
        Scalar::F32 => text.parse::<f32>().ok().map(|v| (f64::from(v), false)),
        Scalar::F64 => text.parse::<f64>().ok().map(|v| (v, false)),
    }
}
