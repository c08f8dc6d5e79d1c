//! Diffracting materials by kind.

pub(crate) mod albedo_normalisation;
pub(crate) mod grating;
mod light_sampler;
mod lobes;
pub(crate) mod memory;
pub(crate) mod power_table;
pub(crate) mod relief;
mod slits;
pub(crate) mod table;

use crate::light::Source;
use crate::material::Context;
use crate::material::notes::Notes;
use crate::material::shading::{Above, Accuracy, Place, add, both_ways};
use crate::material::texture::Grooves;
use crate::scene;
use crate::vector::number;
use grating::{BalancedOrders, Grating, Groove};
use lobes::{lit, under};
use memory::Memory;
use nacre_base::random::Stream;
use nacre_base::{Error, Result};
use nacre_brdf::height::{self, Scale};
use nacre_brdf::{Reflectance, Section, Slits, Window};
use relief::Relief;
pub(crate) use slits::SlitLayout;
use slits::{Comb, Lattice, radial};
use std::f64::consts::FRAC_PI_4;
use table::Table;

/// Range of grating periods in µm, and largest depth.
const PERIODS: [f64; 2] = [0.05, 200.0];
const DEPTHS: [f64; 2] = [0.0, 5.0];

/// Share of light in wrong orders from which reports warn.
const STEEP: f64 = 0.05;

/// A diffracting material.
pub(crate) enum Diffraction {
    Grating { grating: Grating, same: [Option<f64>; 2], maps: Option<Grooves>, disc: bool },
    Comb(Comb),
    Lattice(Lattice),
    Table(Box<Table>),
    Relief(Box<Relief>),
}

impl Diffraction {
    /// Prepares a described material; parts may be shared with `like`, the same material prepared for another accuracy.
    ///
    /// # Errors
    /// `Input` for invalid values and files.
    pub(crate) fn new(
        key: &str,
        of: &scene::Diffraction,
        context: &Context,
        like: Option<&Self>,
        notes: &mut Notes,
    ) -> Result<Self> {
        let Context { folder, observer, accuracy, under, progress } = *context;
        let sub = |what: &str| format!("{key}.{what}");
        let degrees = |what: &str, v: f64| number(&sub(what), v, [-3600.0, 3600.0]).map(f64::to_radians);
        let sigma = |um: f64| number(&sub("coherence_um"), um, [1.0, 1e4]).and_then(|um| Ok(Window::new(um)?.sigma));
        let known = |r: &Reflectance| r.check(nacre_brdf::RANGE_NM);
        notes.predicted_error = 2.0 * accuracy.error;
        match of {
            scene::Diffraction::Grating {
                relief,
                period_um,
                orientation_deg,
                maps,
                repeat,
                coherence_um,
                reflectance,
            } => {
                known(reflectance)?;
                let maps = match maps {
                    Some(path) => {
                        for r in repeat {
                            number(&sub("repeat"), *r, [1e-3, 1e6])?;
                        }
                        Some(Grooves::read(&folder.join(path), *repeat)?)
                    }
                    None => None,
                };
                let period = period_um.map(|p| number(&sub("period_um"), p, PERIODS)).transpose()?;
                let orientation = orientation_deg.map(|d| degrees("orientation_deg", d)).transpose()?;
                let has = maps.as_ref().map_or([false; 2], Grooves::has);
                for (what, given, mapped) in
                    [("orientation_deg", orientation.is_some(), has[0]), ("period_um", period.is_some(), has[1])]
                {
                    if given == mapped {
                        let problem = if given { "is given and in the maps" } else { "is missing" };
                        return Err(Error::input(sub(what), problem, "give it, or a map of it"));
                    }
                }
                let longest = maps.as_ref().map_or(0.0, |m| m.longest_um).max(period.unwrap_or(0.0));
                number(&sub("maps"), longest, PERIODS)?;
                let grating = Self::grating(key, relief, longest, sigma(*coherence_um)?, reflectance, accuracy, notes)?;
                Ok(Self::Grating { grating, same: [orientation, period], maps, disc: false })
            }
            scene::Diffraction::Cd { period_um, relief, coherence_um, reflectance } => {
                known(reflectance)?;
                let period = number(&sub("period_um"), *period_um, PERIODS)?;
                let grating = Self::grating(key, relief, period, sigma(*coherence_um)?, reflectance, accuracy, notes)?;
                Ok(Self::Grating { grating, same: [None, Some(period)], maps: None, disc: true })
            }
            scene::Diffraction::Multislit { spacing_um, width_um, count, orientation_deg, disc, radial } => {
                let slits = Slits { spacing_um: *spacing_um, width_um: *width_um, count: *count };
                notes.method = "sum over slits (2017 paper, Eq. 16), orders balanced".into();
                let layout = match (disc, radial) {
                    (true, true) => return Err(Error::input(sub("radial"), "is true, and so is disc", "keep one")),
                    (true, false) => SlitLayout::Disc,
                    (false, true) => SlitLayout::Radial,
                    (false, false) => SlitLayout::Parallel,
                };
                Ok(Self::Comb(Comb::new(slits, degrees("orientation_deg", *orientation_deg)?, layout)?))
            }
            scene::Diffraction::Lattice { period_um, aperture_um, orientation_deg, coherence_um, reflectance } => {
                known(reflectance)?;
                sigma(*coherence_um)?;
                notes.method = "orders of a lattice of rectangles".into();
                let turn = degrees("orientation_deg", *orientation_deg)?;
                let light = (*coherence_um, reflectance.clone());
                Ok(Self::Lattice(Lattice::new(key, *period_um, *aperture_um, turn, light)?))
            }
            scene::Diffraction::Table { file, albedo, lossless, factors } => {
                let albedo = number(&sub("albedo"), *albedo, [0.0, 1.0])?;
                let mut table = Table::read(&folder.join(file), observer, albedo, *lossless)?;
                table.factors = factors.as_ref().map(|factors| folder.join(factors));
                notes.method = "table over half vectors, per channel".into();
                if table.unknown > 0.0 {
                    let percent = 100.0 * table.unknown;
                    notes.warnings.push(format!("{percent:.1} % of the table are not known and count as dark"));
                }
                Ok(Self::Table(Box::new(table)))
            }
            scene::Diffraction::Heightfield {
                file,
                pixel_um,
                range_um,
                channel,
                fill_gaps,
                orientation_deg,
                coherence_um,
                reflectance,
                lossless,
            } => {
                known(reflectance)?;
                sigma(*coherence_um)?;
                let (pixel_um, range_um, fill_gaps) = (*pixel_um, *range_um, *fill_gaps);
                let scale = Scale { pixel_um, range_um, channel: channel.clone(), fill_gaps };
                let field = height::read(&folder.join(file), &scale)?;
                let turn = degrees("orientation_deg", *orientation_deg)?;
                let light = (*coherence_um, reflectance.clone());
                let like = match like {
                    Some(Self::Relief(like)) => Some(&**like),
                    _ => None,
                };
                let relief = Relief::new(&field, light, (turn, *lossless), (accuracy.error, under), like, progress)?;
                notes.method = format!("Stam's BRDF of the height field: {}", relief.why);
                notes.predicted_error += relief.error;
                Ok(Self::Relief(Box::new(relief)))
            }
        }
    }

    fn grating(
        key: &str,
        relief: &scene::Relief,
        longest_um: f64,
        sigma: f64,
        reflectance: &Reflectance,
        accuracy: &Accuracy,
        notes: &mut Notes,
    ) -> Result<Grating> {
        let depth_um = number(&format!("{key}.relief.depth_um"), relief.depth_um, DEPTHS)?;
        if let height::Profile::Rectangular { duty } = relief.profile {
            number(&format!("{key}.relief.profile"), duty, [0.0, 1.0])?;
        }
        let section = Section::Formula { profile: relief.profile, depth_um };
        let grating = Grating::new(&section, longest_um, sigma, reflectance.clone(), accuracy.error);
        notes.orders = Some(grating.orders);
        let theory = BalancedOrders::theory_error(&section, longest_um, FRAC_PI_4);
        notes.theory_error = Some(theory);
        if theory > STEEP {
            notes.warnings.push(format!(
                "grooves of {depth_um} µm every {longest_um} µm are steep for scalar theory: about {:.0} % of the light is in wrong orders, more where it grazes or grooves are finer",
                100.0 * theory
            ));
        }
        notes.predicted_error += grating.left_out;
        notes.method = format!(
            "exact orders, balanced: ±{} hold all but {:.2e} of the light at any direction; exact ones cost what a first-order theory's cost",
            grating.orders, grating.left_out
        );
        Ok(grating)
    }

    fn groove(&self, uv: [f64; 2]) -> Option<Groove> {
        let Self::Grating { same, maps, disc, .. } = self else { return None };
        if *disc {
            return Some(Groove { across: radial(uv)?, period_um: same[1]? });
        }
        let [orientation, period_um] = match maps {
            Some(maps) => {
                let found = maps.at(uv)?;
                [found[0].or(same[0])?, found[1].or(same[1])?]
            }
            None => [same[0]?, same[1]?],
        };
        let (sin, cos) = orientation.sin_cos();
        Some(Groove { across: [cos, sin], period_um })
    }

    /// Whether nothing diffracts at a point.
    pub(crate) fn is_masked(&self, uv: [f64; 2]) -> bool {
        matches!(self, Self::Grating { .. }) && self.groove(uv).is_none()
    }

    /// X, Y, Z of the reflection of a light with illuminance 1 on a surface that faces it.
    pub(crate) fn lit(&self, place: &Place, source: &Source, accuracy: &Accuracy, memory: &mut Memory) -> [f64; 3] {
        let Source { light, width, seen, .. } = *source;
        let pair = [place.view, light];
        let f = match self {
            Self::Grating { grating, .. } => match self.groove(place.uv) {
                Some(groove) => lit(grating, groove, pair, (width, seen), accuracy, memory),
                None => return [0.0; 3],
            },
            Self::Comb(comb) => comb.lit(place.uv, pair, (width, seen), accuracy, &mut memory.scratch),
            Self::Lattice(lattice) => lattice.lit(pair, (width, seen), accuracy),
            Self::Table(table) => {
                let rgb = table.scattered(light, place.view);
                return seen.reflected(rgb);
            }
            Self::Relief(relief) => return relief.lit(place.view, source, accuracy, &mut memory.workspace),
        };
        f.map(|v| v * light[2])
    }

    /// X, Y, Z of the reflection of an environment.
    pub(crate) fn under(
        &self,
        place: &Place,
        above: &Above,
        random: &mut Stream,
        accuracy: &Accuracy,
        memory: &mut Memory,
    ) -> [f64; 3] {
        let view = place.view;
        let [least, most] = above.sky.upsampling.range();
        let spectrum = most - least;
        match self {
            Self::Grating { grating, .. } => match self.groove(place.uv) {
                Some(groove) => under(above, (grating, groove), view, random.numbers(), accuracy, &mut memory.scratch),
                None => [0.0; 3],
            },
            Self::Comb(comb) => {
                let comb = comb.turned(random);
                comb.under(above, (place.uv, view), random.numbers(), accuracy, &mut memory.scratch)
            }
            Self::Lattice(lattice) => {
                // One order for each of some wave numbers.
                const COUNT: usize = 16;
                let mut sum = [0.0; 3];
                let shift = random.next();
                for k in 0..COUNT {
                    let number = least + spectrum * (k as f64 + shift) / COUNT as f64;
                    let (from, power) = lattice.sample(view, number, random.numbers());
                    let rgb = above.radiance(from);
                    let colors = above.sky.upsampling.at(number);
                    for (color, part) in rgb.iter().zip(&colors) {
                        add(&mut sum, *part, color * power * spectrum / COUNT as f64);
                    }
                }
                sum
            }
            Self::Table(table) => {
                if let Some(summed) = above.summed {
                    let whole = table.whole(view);
                    return above.sky.upsampling.seen([0, 1, 2].map(|c| summed[c].max(0.0) * table.scale / whole[c]));
                }
                let value = |light: [f64; 3], rgb: [f64; 3]| {
                    let f = table.scattered(light, view);
                    above.sky.upsampling.seen([0, 1, 2].map(|c| f[c] * rgb[c]))
                };
                let (at, drawn) = (random.numbers(), table.sample(view, random.numbers()));
                both_ways(above, at, value, drawn, |l| if l[2] > 0.0 { table.density(l, view) } else { 0.0 })
            }
            Self::Relief(relief) => relief.under(view, above, random, &mut memory.workspace),
        }
    }
}
