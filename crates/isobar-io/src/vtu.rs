//! VTK XML unstructured grids (`.vtu`): the arrays of a piece to tetrahedra. The tags are read by [`crate::vti`], the arrays by [`crate::vti_data`].
//!
//! Format: VTK file formats, "UnstructuredGrid", <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.

use crate::cells::{Cells, field, indices, points};
use crate::error::{Cause, quoted};
use crate::field::Named;
use crate::input::Input;
use crate::sample::{Layout, Pick};
use crate::vti::{Array, Image, Section, malformed};
use crate::{Loaded, Options, lagrange, vti_data};

/// Reads the mesh whose tags are `image`.
pub(crate) fn read(input: &dyn Input, image: &Image, o: &Options) -> Result<Loaded, Cause> {
    let named: Vec<Named> = image.arrays.iter().map(|a| a.named.clone()).collect();
    let (choice, fields) = field(&named, o, "VTU")?;
    let [n_points, n_cells] = image.counts.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
    if n_cells == 0 {
        return Err(malformed("there are no cells"));
    }
    let numbers = |array: &Array, count: usize, components: usize| {
        if array.named.components != components {
            return Err(malformed(format!(
                "array {} has {} components instead of {components}",
                quoted(&array.named.name),
                array.named.components
            )));
        }
        let layout = layout(image, array, count, Pick::Component(0))?;
        vti_data::numbers(input, &image.storage, &array.place, &layout)
    };
    let of = |section: Section, name: &str| {
        image
            .cells
            .iter()
            .find(|(s, a)| *s == section && (section == Section::Points || a.named.name == name))
            .map(|(_, a)| a)
            .ok_or_else(|| malformed(format!("the array {name} is missing")))
    };
    let points = points(&numbers(of(Section::Points, "Points")?, n_points, 3)?)?;
    let types = numbers(of(Section::Cells, "types")?, n_cells, 1)?;
    let ends = ends(&numbers(of(Section::Cells, "offsets")?, n_cells, 1)?)?;
    let total = ends.last().copied().unwrap_or(0);
    let corners = indices(&numbers(of(Section::Cells, "connectivity")?, total, 1)?, points.len())?;
    let array = &image.arrays[choice.array];
    let on_cells = array.named.on_cells;
    let layout = layout(image, array, if on_cells { n_cells } else { n_points }, choice.pick)?;
    let mut notes = Vec::new();
    if o.as_hexes || types.contains(&f64::from(lagrange::TYPE)) {
        let all = vti_data::numbers(input, &image.storage, &array.place, &layout)?;
        let cells = lagrange::Cells {
            points,
            types: types.iter().map(|&t| t as u8).collect(),
            ends,
            corners,
            values: picked(&all, &layout),
            on_cells,
            new_numbering: image.minor >= 2,
        };
        return cells.loaded(choice, fields, notes, o);
    }
    let samples = vti_data::read(input, &image.storage, &array.place, &layout, &mut notes)?;
    let values = (0..samples.len()).map(|i| samples.get(i) as f32).collect();
    let cells = Cells {
        points,
        types: types.iter().map(|&t| t as u8).collect(),
        ends,
        corners,
    };
    cells.loaded(values, on_cells, choice, fields, notes, o)
}

/// What `layout` picks of each tuple of all its numbers.
pub(crate) fn picked(all: &[f64], layout: &Layout) -> Vec<f64> {
    all.chunks_exact(layout.components)
        .map(|t| match layout.pick {
            Pick::Component(c) => t[c],
            Pick::Magnitude => t.iter().map(|v| v * v).sum::<f64>().sqrt(),
        })
        .collect()
}

/// Offsets of the cells' ends: whole numbers that do not fall.
pub(crate) fn ends(numbers: &[f64]) -> Result<Vec<usize>, Cause> {
    let mut last = 0.0;
    numbers
        .iter()
        .map(|&v| {
            if !(v >= last && v < 9e15) {
                return Err(Cause::malformed(
                    "mesh",
                    format!("the offset {v} of a cell stands after {last}"),
                ));
            }
            last = v;
            Ok(v as usize)
        })
        .collect()
}

fn layout(image: &Image, array: &Array, count: usize, pick: Pick) -> Result<Layout, Cause> {
    Ok(Layout {
        scalar: array.scalar.ok_or_else(|| Cause::Unsupported {
            format: "VTU",
            what: format!("array {} of a type that is not a number", quoted(&array.named.name)),
            remedy: "choose another with --field",
        })?,
        big_endian: image.storage.big_endian,
        components: array.named.components,
        pick,
        count,
        scale: None,
    })
}
