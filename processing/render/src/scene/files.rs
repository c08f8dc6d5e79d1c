//! The files that a scene refers to.

use crate::scene::{Base, Bright, Color, Coverage, Diffraction, Light, Material, Scene, Shape, Spectrum, Value};
use nacre_base::{Error, Result};
use nacre_optics::color::Illuminant;
use std::path::{Component, Path};

/// Whether a relative path stays within its folder.
pub(crate) fn inside(path: &Path) -> bool {
    let stays = |c: Component| matches!(c, Component::Normal(_) | Component::CurDir);
    !path.as_os_str().is_empty() && path.components().all(stays)
}

impl Scene {
    /// All referenced files, with their keys.
    pub fn files(&self) -> Vec<(String, &Path)> {
        let mut files = vec![];
        for (k, shape) in self.shape.iter().enumerate() {
            if let Shape::Mesh { file, .. } = shape {
                files.push((format!("shape[{k}].file"), file.as_path()));
            }
        }
        for (k, light) in self.light.iter().enumerate() {
            match light {
                Light::Point { spectrum, .. }
                | Light::Directional { spectrum, .. }
                | Light::Spot { spectrum, .. }
                | Light::Rectangle { spectrum, .. } => match spectrum {
                    Spectrum::Named(name) if Illuminant::named(name).is_none() => {
                        files.push((format!("light[{k}].spectrum"), Path::new(name)));
                    }
                    Spectrum::Named(_) | Spectrum::LineNm(_) => {}
                },
                Light::Environment { file, .. } => {
                    files.extend(file.iter().map(|file| (format!("light[{k}].file"), file.as_path())));
                }
            }
        }
        for (name, material) in &self.material {
            of_material(&format!("material.{name}"), material, &mut files);
        }
        files
    }

    /// Refuses a scene that refers to files outside its folder, or to missing ones: the sender of a scene must not read
    /// this machine's files.
    ///
    /// # Errors
    /// `Input`, which names key and file.
    pub fn check_files(&self, folder: &Path) -> Result<()> {
        for (key, path) in self.files() {
            let shown = path.display();
            if !inside(path) {
                let remedy = "put the file beside the scene and give its name alone";
                return Err(Error::input(key, format!("is {shown:?}, which is outside of the scene's folder"), remedy));
            }
            if !folder.join(path).exists() {
                let remedy = "send the file together with the scene, or correct the name";
                return Err(Error::input(key, format!("is {shown:?}, which is not there"), remedy));
            }
        }
        Ok(())
    }
}

/// Patterns list all fields explicitly, so that the compiler points here when a key is added.
fn of_material<'a>(key: &str, material: &'a Material, files: &mut Vec<(String, &'a Path)>) {
    let Material { base, diffraction, coverage, blend: _, normals } = material;
    let mut add = |what: &str, file: &'a Path| files.push((format!("{key}.{what}"), file));
    if let Some(Base { albedo, roughness, specular: _ }) = base {
        if let Color::File(file) = albedo {
            add("base.albedo", file);
        }
        if let Value::File(file) = roughness {
            add("base.roughness", file);
        }
    }
    match coverage {
        Coverage::File(file) => add("coverage", file),
        Coverage::Bright(Bright { photograph, threshold: _ }) => add("coverage.photograph", photograph),
        Coverage::Number(_) => {}
    }
    if let Some(file) = normals {
        add("normals", file);
    }
    match diffraction {
        Some(Diffraction::Grating { maps: Some(file), .. }) => add("diffraction.maps", file),
        Some(Diffraction::Table { file, factors, .. }) => {
            add("diffraction.file", file);
            if let Some(folder) = factors {
                add("diffraction.factors", folder);
            }
        }
        Some(Diffraction::Heightfield { file, .. }) => add("diffraction.file", file),
        Some(
            Diffraction::Grating { maps: None, .. }
            | Diffraction::Cd { .. }
            | Diffraction::Multislit { .. }
            | Diffraction::Lattice { .. },
        )
        | None => {}
    }
}
