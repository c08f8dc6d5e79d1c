//! Hints about unstated defaults that determine a picture.

use nacre_base::text::from_toml;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// Keys of a scene with such defaults, and the keys that decide whether they matter.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Stated {
    light: Vec<Light>,
    material: BTreeMap<String, Material>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Light {
    r#type: String,
    file: Option<IgnoredAny>,
    up: Option<IgnoredAny>,
    sigma_mm: Option<IgnoredAny>,
    sigma_deg: Option<IgnoredAny>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Material {
    diffraction: Option<Diffraction>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Diffraction {
    r#type: String,
    coherence_um: Option<IgnoredAny>,
    reflectance: Option<IgnoredAny>,
    spacing_um: Option<IgnoredAny>,
}

/// One line for each unstated default that determines the picture of a scene.
pub(super) fn hints(text: &str) -> Vec<String> {
    let Ok(Stated { light, material }) = from_toml::<Stated>(text) else { return vec![] };
    let mut hints: Vec<String> = light.iter().enumerate().filter_map(|(k, light)| light.hint(k + 1)).collect();
    for (name, material) in &material {
        hints.extend(material.diffraction.iter().flat_map(|of| of.hints(name)));
    }
    hints
}

impl Light {
    fn hint(&self, number: usize) -> Option<String> {
        let unsized_light = self.sigma_mm.is_none() && self.sigma_deg.is_none();
        match self.r#type.as_str() {
            "environment" if self.file.is_some() && self.up.is_none() => Some(format!(
                "light {number}: the environment's zenith is +y (up = [0, 1, 0]); above a sample that lies in z = 0 it is up = [0, 0, 1]"
            )),
            "point" if unsized_light => {
                Some(format!("light {number} has no size (sigma_mm = 0): colours are as narrow as coherence_um allows"))
            }
            "directional" if unsized_light => Some(format!(
                "light {number} has no size (sigma_deg = 0; the sun's is 0.13): colours are as narrow as coherence_um allows"
            )),
            _ => None,
        }
    }
}

impl Diffraction {
    fn hints(&self, name: &str) -> Vec<String> {
        let mut hints = vec![];
        let grooves = ["grating", "cd", "lattice", "heightfield"].contains(&self.r#type.as_str());
        if grooves && self.coherence_um.is_none() {
            hints.push(format!("material {name}: colours are those of light coherent over coherence_um = 65; smaller facets make them wider"));
        }
        if grooves && self.reflectance.is_none() {
            hints.push(format!(
                "material {name} reflects all light (reflectance = \"perfect\"); a metal has less, and its colour"
            ));
        }
        if self.r#type == "multislit" && self.spacing_um.is_none() {
            hints.push(format!(
                "material {name} has the slits of the 2017 paper's compact disc (spacing_um = 2; discs have 1.6)"
            ));
        }
        hints
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decisive_defaults_are_reported() {
        let scene = |light: &str, diffraction: &str| {
            format!("[[light]]\n{light}\n[material.foil.diffraction]\n{diffraction}\n")
        };
        let sky = "type = \"environment\"\nfile = \"sky.exr\"";
        let foil = "type = \"grating\"\ncoherence_um = 20\nreflectance = \"perfect\"";
        let found = hints(&scene(sky, foil));
        assert!(found.len() == 1 && found[0].contains("light 1: the environment's zenith is +y"), "{found:?}");
        assert!(hints(&scene(&format!("{sky}\nup = [0, 0, 1]"), foil)).is_empty());
        // A constant colour has no direction.
        assert!(hints(&scene("type = \"environment\"\ncolor = [1, 1, 1]", foil)).is_empty());
        let found = hints(&scene("type = \"point\"\nposition = [0, 0, 1]", "type = \"cd\""));
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found.iter().skip(1).all(|h| h.starts_with("material foil")), "{found:?}");
        assert!(hints(&scene("type = \"point\"\nsigma_mm = 2", "type = \"multislit\""))[0].contains("spacing_um = 2"));
        assert!(hints("[[").is_empty());
    }
}
