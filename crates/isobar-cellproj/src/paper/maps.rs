//! The textures themselves, to be looked at (Figures 6, 12, 13 and 15 of the paper).

use super::settings::Settings;
use super::textures::{Texture2, Volume};
use super::{Mesh, Textures};
use crate::CELLPROJ_CPU_PAPER;
use crate::measure::Lengths;
use crate::mesh::Cells;
use crate::normals::at_points;
use crate::topology::Topology;

use isobar_core::{Knobs, Method as _, RenderError, Surface, TetMesh, TransferFunction};
use isobar_cpu::scene::Isovalues;

/// A texture: texels row by row, linear premultiplied colour and opacity; s_f from the least to the greatest value of the mesh along a row, s_b along the rows.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureMap {
    /// Texels along each side.
    pub side: usize,
    /// `side * side` of them.
    pub texels: Vec<[f32; 4]>,
}

/// The textures that `cellproj/cpu-paper` draws a scene with.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureMaps {
    /// Section 7 and Figure 6, the single pass; `None` without surfaces.
    pub flat: Option<TextureMap>,
    /// Section 8 and Figure 13, left: the back faces' pass.
    pub back: Option<TextureMap>,
    /// Section 8 and Figure 13, right: the front faces' pass.
    pub front: Option<TextureMap>,
    /// Section 4: one map at the average thickness, divided by its greatest opacity (Figures 13, middle, and 15); section 3: one for each length from 0 to the longest
    /// (Figure 12); empty without a transfer function, or for a volume that has no texture over (s_f, s_b).
    pub volume: Vec<TextureMap>,
}

impl TextureMaps {
    /// The textures of a scene, with the knobs of the method `cellproj/cpu-paper`.
    ///
    /// # Errors
    /// [`RenderError::Data`] for a mesh without volume, [`RenderError::Knob`], [`RenderError::Unsupported`] for surfaces that are no isovalues or what cannot be mixed.
    pub fn new(
        mesh: &TetMesh,
        surfaces: &[Surface],
        transfer: Option<&TransferFunction>,
        knobs: &Knobs,
    ) -> Result<Self, RenderError> {
        let settings = Settings::new(knobs)?;
        let surfaces = Isovalues::new(CELLPROJ_CPU_PAPER.info(), surfaces)?;
        settings.check(surfaces.all(), transfer.is_some())?;
        let cells = Cells::new(mesh)?;
        let (lo, hi) = cells.range();
        let mesh = Mesh {
            topology: Topology::new(&cells)?,
            lengths: Lengths::new(&cells),
            range: (f64::from(lo), f64::from(hi)),
            normals: Some(at_points(&cells)),
            cells,
        };
        let made = Textures::new(&mesh, &surfaces, transfer, &settings);
        let isosurfaces = |k: usize| {
            made.isosurfaces.as_ref().map(|i| {
                let (side, texels) = i.map(k);
                TextureMap {
                    side,
                    texels: texels.iter().map(|t| t.to_array()).collect(),
                }
            })
        };
        let of = |t: &Texture2| TextureMap {
            side: t.axes[0].nodes(),
            texels: t.texels.iter().map(|t| t.to_array()).collect(),
        };
        let volume = match &made.volume {
            Some(Volume::Table3 { slices, .. }) => slices.iter().map(of).collect(),
            Some(Volume::Table2 { texture, .. }) => vec![of(texture)],
            _ => Vec::new(),
        };
        Ok(Self {
            flat: isosurfaces(0),
            back: isosurfaces(1),
            front: isosurfaces(2),
            volume,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::DVec3;

    /// Section 7: opaque where one value is below the isovalue and the other is not; section 8: there the weight on the front.
    #[test]
    fn the_maps_of_one_isovalue() {
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let mesh = TetMesh::new(points.into(), vec![[0, 1, 2, 3]].into(), vec![0.0, 0.0, 0.0, 1.0].into()).unwrap();
        let surfaces = [Surface::isovalue(0.3, 0)];
        let knobs = Knobs::default().with("texture", 11);
        let maps = TextureMaps::new(&mesh, &surfaces, None, &knobs).unwrap();
        let (flat, front) = (maps.flat.unwrap(), maps.front.unwrap());
        assert!(maps.volume.is_empty() && flat.side == 11 && flat.texels.len() == 121);
        for b in 0..11 {
            for f in 0..11 {
                let (s_f, s_b) = (f as f32 / 10.0, b as f32 / 10.0);
                let set = (s_f < 0.299) != (s_b < 0.299);
                let i = b * 11 + f;
                assert_eq!(flat.texels[i][3] > 0.5, set, "{f} {b}");
                let weight = if set { (0.3 - s_b) / (s_f - s_b) } else { 0.0 };
                assert!((front.texels[i][3] - weight).abs() < 1e-5, "{f} {b}");
            }
        }
        let bad = Knobs::default().with("texture", 1);
        assert!(TextureMaps::new(&mesh, &surfaces, None, &bad).is_err());
    }
}
