//! Lookup textures of the shaders.

use super::repeating::Field;
use super::texture::Texture;
use crate::light::Lamp;
use crate::light::viewer::RANGE;
use crate::material::base;
use crate::material::diffraction::Diffraction;
use crate::material::diffraction::grating::{Grating, STEP};
use crate::material::diffraction::table::{Table, VIEWS};
use crate::material::texture::{Grooves, Picture};
use crate::shape::mesh::Mesh;
use nacre_brdf::Reflectance;

/// Maximum rows of the orders' powers, the texture height supported by every card.
const ROWS: usize = 2048;

/// Number of tabulated cosines and wave numbers of the reflectance.
const COSINES: usize = 256;
const NUMBERS: usize = 64;

/// All textures except those of environments and meshes, in the order of their bindings, and the parameters of a height
/// field.
pub(super) fn all(
    diffraction: Option<&Diffraction>,
    lamps: &[Lamp],
    most: usize,
    field: Option<Field>,
) -> Vec<Texture> {
    let [mut grooves, mut powers, mut mirror] =
        [("maps", 4), ("powers", 1), ("mirror", 1)].map(|(name, channels)| Texture::none(name, channels));
    let [mut table, mut albedo] = ["half_vectors", "half_albedo"].map(|name| Texture::none(name, 4));
    match diffraction {
        Some(Diffraction::Grating { grating, maps, .. }) => {
            grooves = maps.as_ref().map_or(grooves, |m| self::maps(m, most.max(1)));
            powers = self::powers(grating);
            mirror = self::mirror(&grating.reflectance);
        }
        Some(Diffraction::Comb(comb)) => {
            powers = self::powers(&comb.orders);
            mirror = self::mirror(&comb.orders.reflectance);
        }
        Some(Diffraction::Lattice(lattice)) => {
            // Under an environment, orders are sampled from their cumulative sums.
            let values = lattice.running.iter().flatten().map(|v| *v as f32).collect();
            powers = Texture::new("powers", lattice.running[0].len(), 1, values);
            mirror = self::mirror(&lattice.reflectance);
        }
        Some(Diffraction::Relief(relief)) => mirror = self::mirror(&relief.reflectance),
        Some(Diffraction::Table(of)) => (table, albedo) = half_vectors(of),
        None => {}
    }
    let [terms, phases, norm] = match field {
        Some(Field { terms, phases, norm, .. }) => [terms, phases, norm],
        None => [("terms", 4), ("phases", 4), ("norm", 1)].map(|(name, channels)| Texture::none(name, channels)),
    };
    let rough = base::tables().into_iter().flatten().map(|v| v as f32).collect();
    let rough = Texture::new("rough", base::COSINES, 4, rough);
    vec![grooves, spectra(lamps), powers, mirror, table, albedo, rough, terms, phases, norm]
}

/// Texels per row of a mesh, the texture width supported by every card.
const MESH_WIDTH: usize = 2048;

/// Nodes and triangles of a mesh, and the number of nodes.
pub(super) fn mesh(of: &Mesh) -> (usize, Texture) {
    let (nodes, mut texels) = of.packed();
    texels.resize(texels.len().next_multiple_of(MESH_WIDTH), [0.0; 4]);
    (nodes, Texture::new("mesh", MESH_WIDTH, 4, texels.into_flattened()))
}

/// Orientation, period, σ and validity.
fn maps(of: &Grooves, most: usize) -> Texture {
    let Some(any) = of.orientation.as_ref().or(of.period.as_ref()) else { return Texture::none("maps", 4) };
    let step = any.width.max(any.height).div_ceil(most).max(1);
    let mut values = vec![];
    for y in (0..any.height).step_by(step) {
        for x in (0..any.width).step_by(step) {
            let k = y * any.width + x;
            let at = |p: &Option<Picture<1>>| p.as_ref().map_or(0.0, |p| p.values[k][0]);
            let (orientation, period) = (at(&of.orientation), at(&of.period));
            let sigma = of.sigma.as_ref().and_then(|s| s.get(k)).copied().filter(|s| s.is_finite()).unwrap_or(0.0);
            if orientation.is_finite() && period.is_finite() {
                values.extend([orientation, period, sigma.max(0.0), 1.0]);
            } else {
                values.extend([0.0; 4]);
            }
        }
    }
    Texture::new("maps", any.width.div_ceil(step), 4, values)
}

/// X, Y, Z over wave numbers, one row per light.
fn spectra(lamps: &[Lamp]) -> Texture {
    let Some(first) = lamps.first() else { return Texture::none("spectra", 4) };
    let texel = |v: &[f64; 3]| [v[0] as f32, v[1] as f32, v[2] as f32, 0.0];
    let values = lamps.iter().flat_map(|lamp| lamp.seen.table.iter().flat_map(texel)).collect();
    Texture::new("spectra", first.seen.table.len(), 4, values)
}

/// Subsampling factor of a grating's table rows.
fn stride(grating: &Grating) -> usize {
    let width = (2 * grating.most + 1) as usize;
    (grating.table.len() / width).div_ceil(ROWS - 1).max(1)
}

/// Rows of [`powers`] per 1/µm of q.
pub(super) fn rows_per_q(grating: &Grating) -> f64 {
    grating.depth_um / (STEP * stride(grating) as f64)
}

/// Powers of the significant orders.
fn powers(grating: &Grating) -> Texture {
    let width = (2 * grating.most + 1) as usize;
    let beyond = (grating.most - grating.orders) as usize;
    let rows: Vec<&[f32]> = grating.table.chunks_exact(width).collect();
    let chosen = rows.iter().step_by(stride(grating)).chain(rows.last());
    let values = chosen.flat_map(|row| row[beyond..width - beyond].iter().copied()).collect();
    Texture::new("powers", (2 * grating.orders + 1) as usize, 1, values)
}

/// Reflectance over cosines and wave numbers.
fn mirror(of: &Reflectance) -> Texture {
    let at = |k: usize| {
        let (x, y) = ((k % COSINES) as f64 / (COSINES - 1) as f64, (k / COSINES) as f64 / (NUMBERS - 1) as f64);
        of.at(x, 1e3 / (RANGE[0] + y * (RANGE[1] - RANGE[0]))) as f32
    };
    Texture::new("mirror", COSINES, 1, (0..COSINES * NUMBERS).map(at).collect())
}

/// Entries and albedo of a lookup table.
fn half_vectors(table: &Table) -> (Texture, Texture) {
    let entries = table.rgb.iter().flat_map(|v| [v[0], v[1], v[2], 0.0]).collect();
    let albedo = table.albedo().flat_map(|v| [v[0] as f32, v[1] as f32, v[2] as f32, 0.0]).collect();
    (Texture::new("half_vectors", table.size, 4, entries), Texture::new("half_albedo", VIEWS, 4, albedo))
}
