//! What the examples that draw figures share: reading data, writing pictures.

use isobar_core::Data;
use isobar_fields::Synthetic;
use isobar_octree::figures::Image;
use std::error::Error;
use std::path::Path;

/// A file, or a synthetic field by its name.
pub(crate) fn load(source: &str) -> Result<Data, Box<dyn Error>> {
    Ok(match source.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
    })
}

/// Writes `FOLDER/NAME.png` and says so; without a folder nothing.
pub(crate) fn save(folder: Option<&Path>, name: &str, image: &Image) -> Result<(), Box<dyn Error>> {
    let Some(folder) = folder else { return Ok(()) };
    std::fs::create_dir_all(folder)?;
    let path = folder.join(format!("{name}.png"));
    let (width, height) = (u32::try_from(image.width)?, u32::try_from(image.height)?);
    let picture = image::RgbImage::from_raw(width, height, image.rgb.clone()).ok_or("three bytes a pixel")?;
    picture.save(&path)?;
    println!("    {}", path.display());
    Ok(())
}
