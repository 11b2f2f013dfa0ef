//! Which array, and which part of it, is the scalar field asked for.

use crate::error::Cause;
use crate::sample::Pick;
use std::collections::HashSet;

/// Tuples with more components are not offered: no field has them, and a hostile header could ask for a name for each.
const MOST_COMPONENTS: usize = 64;

/// An array of a file that holds several.
#[derive(Debug, Clone)]
pub(crate) struct Named {
    /// Its name; may be empty.
    pub(crate) name: String,
    /// Values per tuple.
    pub(crate) components: usize,
    /// Whether it belongs to cells rather than points.
    pub(crate) on_cells: bool,
}

/// One scalar field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Choice {
    /// Its name for `--field`.
    pub(crate) name: String,
    /// Index of the array.
    pub(crate) array: usize,
    /// What is taken of each tuple.
    pub(crate) pick: Pick,
}

/// All scalar fields, those of the points first: a scalar by its name; a vector (3 components) as NAME (its magnitude), NAME-x, NAME-y,
/// NAME-z; other tuples as NAME-0, NAME-1, ... An array of cells whose name a point array has gets `-cells` after it.
pub(crate) fn choices(arrays: &[Named]) -> Vec<Choice> {
    let mut all: Vec<Choice> = Vec::new();
    let on_points: HashSet<&str> = arrays.iter().filter(|a| !a.on_cells).map(|a| a.name.as_str()).collect();
    for cells in [false, true] {
        for (array, a) in arrays.iter().enumerate().filter(|(_, a)| a.on_cells == cells) {
            let mut name = if a.name.trim().is_empty() {
                format!("array-{array}")
            } else {
                a.name.clone()
            };
            if cells && on_points.contains(a.name.as_str()) {
                name.push_str("-cells");
            }
            let mut add = |name: String, pick| all.push(Choice { name, array, pick });
            match a.components {
                1 => add(name, Pick::Component(0)),
                3 => {
                    add(name.clone(), Pick::Magnitude);
                    for (c, axis) in ["x", "y", "z"].iter().enumerate() {
                        add(format!("{name}-{axis}"), Pick::Component(c));
                    }
                }
                n if n <= MOST_COMPONENTS => (0..n).for_each(|c| add(format!("{name}-{c}"), Pick::Component(c))),
                _ => {}
            }
        }
    }
    all
}

/// The field asked for; without a name the first scalar array of the points, then of the cells, then the first field of any kind.
pub(crate) fn choose<'a>(choices: &'a [Choice], arrays: &[Named], asked: Option<&str>) -> Result<&'a Choice, Cause> {
    let Some(asked) = asked else {
        return choices
            .iter()
            .find(|c| arrays[c.array].components == 1)
            .or(choices.first())
            .ok_or(Cause::NoFields);
    };
    choices
        .iter()
        .find(|c| c.name == asked)
        .ok_or_else(|| no_field(asked, choices.iter().map(|c| c.name.as_str())))
}

/// The error that names the fields there are.
pub(crate) fn no_field<'a>(asked: &str, have: impl Iterator<Item = &'a str>) -> Cause {
    /// Names listed before "..." stands for the rest.
    const LISTED: usize = 24;
    let have: Vec<&str> = have.collect();
    let mut text = have.iter().take(LISTED).copied().collect::<Vec<_>>().join(", ");
    if have.len() > LISTED {
        text.push_str(", ...");
    }
    Cause::NoField {
        asked: crate::error::quoted(asked),
        have: crate::error::one_line(&text, 800),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str, components: usize, on_cells: bool) -> Named {
        Named {
            name: name.into(),
            components,
            on_cells,
        }
    }

    #[test]
    fn the_default_is_the_first_scalar_of_the_points() {
        let arrays = [
            named("c", 1, true),
            named("v", 3, false),
            named("s", 1, false),
            named("s", 1, true),
            named("uv", 2, false),
        ];
        let all = choices(&arrays);
        let names: Vec<_> = all.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["v", "v-x", "v-y", "v-z", "s", "uv-0", "uv-1", "c", "s-cells"]);
        assert_eq!(choose(&all, &arrays, None).unwrap().name, "s");
        assert_eq!(choose(&all, &arrays, Some("v")).unwrap().pick, Pick::Magnitude);
        assert_eq!(choose(&all, &arrays, Some("v-z")).unwrap().pick, Pick::Component(2));
        assert_eq!(choose(&all, &arrays, Some("s-cells")).unwrap().array, 3);
        let error = choose(&all, &arrays, Some("w")).unwrap_err().to_string();
        assert!(error.contains("\"w\"") && error.contains("s-cells"), "{error}");
        assert!(matches!(choose(&[], &[], None), Err(Cause::NoFields)));
        assert!(choices(&[named("big", usize::MAX, false)]).is_empty());
    }
}
