//! Raw volumes with the header in the name, as the Open SciVis Datasets have them: `NAME_WxHxD_TYPE.raw`, also `.raw.gz`.
//!
//! W, H, D are samples along x (fastest), y, z; TYPE is int8, uint8, int16, uint16, int32, uint32, int64, uint64, float32 (float) or float64
//! (double), little-endian. Spacing 1, origin 0: the name does not say more (write a detached NRRD header for a volume that has a spacing).

use crate::error::Cause;
use crate::input::{Input, Packing, finish, sized};
use crate::sample::{Layout, Pick, Scalar, count, read_binary};
use crate::volume::{Geometry, loaded, only_field};
use crate::{Loaded, Options};
use isobar_core::DVec3;

/// What a name says.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Named {
    dims: [u64; 3],
    scalar: Scalar,
}

/// Dimensions and type, where the name has both.
pub(crate) fn name(name: &str) -> Option<Named> {
    let lower = name.to_ascii_lowercase();
    let stem = lower.strip_suffix(".gz").unwrap_or(&lower).strip_suffix(".raw")?;
    let (rest, scalar) = stem.rsplit_once('_')?;
    let (_, dims) = rest.rsplit_once('_')?;
    let mut numbers = dims.split('x').map(str::parse::<u64>);
    let mut next = || numbers.next()?.ok();
    let dims = [next()?, next()?, next()?];
    if numbers.next().is_some() {
        return None;
    }
    let scalar = match scalar {
        "int8" => Scalar::I8,
        "uint8" => Scalar::U8,
        "int16" => Scalar::I16,
        "uint16" => Scalar::U16,
        "int32" => Scalar::I32,
        "uint32" => Scalar::U32,
        "int64" => Scalar::I64,
        "uint64" => Scalar::U64,
        "float32" | "float" => Scalar::F32,
        "float64" | "double" => Scalar::F64,
        _ => return None,
    };
    Some(Named { dims, scalar })
}

/// Reads a raw volume. More data than the name says is an error: nothing else would show a wrong name.
pub(crate) fn read(input: &dyn Input, named: &Named, packing: Packing, o: &Options) -> Result<Loaded, Cause> {
    let field = only_field("value", o)?;
    let layout = Layout {
        scalar: named.scalar,
        big_endian: false,
        components: 1,
        pick: Pick::Component(0),
        count: count(named.dims)?,
        scale: None,
    };
    let declared = layout.bytes().ok_or(Cause::Dims(named.dims))?;
    if packing == Packing::None && input.len() != declared {
        return Err(Cause::Size {
            declared,
            found: input.len(),
        });
    }
    let geometry = Geometry::aligned(named.dims, DVec3::ONE, DVec3::ZERO);
    geometry.check()?;
    let mut notes = Vec::new();
    let mut reader = sized(input, 0, packing, 0, declared)?;
    let samples = read_binary(&mut *reader, &layout, &mut notes)?;
    if finish(&mut *reader)? {
        return Err(Cause::malformed(
            "raw volume",
            format!("there are more than the {declared} bytes its name says"),
        ));
    }
    loaded(geometry, samples, field.clone(), vec![field], notes, o)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_taken_apart() {
        let some = |dims, scalar| Some(Named { dims, scalar });
        assert_eq!(name("fuel_64x64x64_uint8.raw"), some([64; 3], Scalar::U8));
        assert_eq!(name("a_b_1x2x3_float32.raw.gz"), some([1, 2, 3], Scalar::F32));
        assert_eq!(name("X_4x5x6_INT16.RAW"), some([4, 5, 6], Scalar::I16));
        for no in [
            "fuel_64x64x64_uint8.rav",
            "fuel_64x64_uint8.raw",
            "fuel_64x64x64x2_uint8.raw",
            "fuel_64x64x64_bit.raw",
            "64x64x64.raw",
            "fuel_64x-4x64_uint8.raw",
            "fuel_99999999999999999999x1x1_uint8.raw",
        ] {
            assert_eq!(name(no), None, "{no}");
        }
    }
}
