//! `nacre brdf orders`.

use super::common::List;
use crate::console::Console;
use nacre_base::operation::lines;
use nacre_base::{Error, vacant};
use nacre_brdf::height::Profile;
use nacre_brdf::output::check_rows;
use nacre_brdf::{Direction, OrderMethod, Pair, Section, most_orders};
use nacre_capture::Failure;
use nacre_image::write_whole;
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Arguments of `nacre brdf orders`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf orders --period-um 1.66 --depth-um 0.1 --out orders.csv
  nacre brdf orders --period-um 2.5 --depth-um 0.3 --profile blazed --light 30 --wavelengths 550 --out blazed.csv
  nacre brdf orders --period-um 1.66 --depth-um 0.2 --method taylor2 --out paper.csv        for comparison: gains light
  nacre brdf orders --period-um 2.5 --profile section.csv --out measured.csv                rows \"x_um,height_um\"

Writes FILE.csv with these columns:
  wavelength_nm, order
  efficiency   fraction of the reflected light, with the phase depth of the mirror direction; sums to 1 over all orders
  theta_r_deg  angle of the order, positive towards the light; NaN for evanescent orders
  flux         fraction of the light by Stam's BRDF, with the phase and gain of the order's own direction
The theory is scalar: `nacre brdf` ignores polarization.")]
pub struct Orders {
    /// Period in µm.
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    period_um: f64,
    /// Peak-to-valley depth in µm; a cross-section file states its own.
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    depth_um: Option<f64>,
    /// Cross-section: sinusoid, blazed, rectangular, rectangular=DUTY (raised fraction of the period), or a CSV file.
    #[arg(long, default_value = "sinusoid", value_name = "NAME|FILE.csv")]
    profile: String,
    /// Angle of incidence from the normal in degrees, in the plane across the grooves.
    #[arg(long, default_value_t = 0.0, value_name = "THETA", allow_negative_numbers = true)]
    light: f64,
    /// Wavelengths in nm: FROM:TO:STEP or a list of numbers.
    #[arg(long, default_value = "380:780:5", value_name = "LIST")]
    wavelengths: List,
    /// Method: exact, or taylor2 for the paper's second-order Taylor lobes.
    #[arg(long, default_value = "exact", value_name = "exact|taylor2", value_parser = method)]
    method: OrderMethod,
    /// Table of orders (CSV).
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

fn method(text: &str) -> Result<OrderMethod, String> {
    match text {
        "exact" => Ok(OrderMethod::Exact),
        "taylor2" => Ok(OrderMethod::Taylor2),
        _ => Err("give exact or taylor2".into()),
    }
}

/// One diffraction order at one wavelength.
#[derive(Serialize)]
struct Row {
    wavelength_nm: f64,
    order: i32,
    efficiency: f64,
    theta_r_deg: Option<f64>,
    flux: Option<f64>,
}

/// JSON output of the command.
#[derive(Serialize)]
struct Report {
    method: OrderMethod,
    period_um: f64,
    depth_um: f64,
    /// Minimum and maximum over the wavelengths of the summed efficiencies; 1 when the orders hold all reflected light.
    sums: [f64; 2],
    warnings: Vec<String>,
    orders: Vec<Row>,
}

impl Orders {
    fn section(&self) -> Result<Section, Error> {
        let wrong = |what: &str, problem: String, remedy: &str| Err(Error::input(what, problem, remedy));
        if !(self.period_um > 0.0 && self.period_um <= 1e4) {
            return wrong("--period-um", format!("is {}", self.period_um), "give a number above 0, at most 10000");
        }
        let profile = match self.profile.split_once('=').unwrap_or((&self.profile, "")) {
            ("sinusoid", "") => Profile::Sinusoid,
            ("blazed", "") => Profile::Blazed,
            ("rectangular", "") => Profile::Rectangular { duty: 0.5 },
            ("rectangular", share) => match share.parse() {
                Ok(duty) if duty > 0.0 && duty < 1.0 => Profile::Rectangular { duty },
                _ => return wrong("--profile", format!("has a share of {share:?}"), "give a number between 0 and 1"),
            },
            _ if Path::new(&self.profile).exists() => return Section::read(Path::new(&self.profile), self.period_um),
            _ => {
                let problem = format!("{:?} is neither a shape nor a file", self.profile);
                return wrong("--profile", problem, "give sinusoid, blazed, rectangular, or a CSV file");
            }
        };
        match self.depth_um {
            Some(depth_um) if (0.0..=50.0).contains(&depth_um) => Ok(Section::Formula { profile, depth_um }),
            Some(depth) => wrong("--depth-um", format!("is {depth}"), "give 0 to 50"),
            None => wrong("--depth-um", "is not given".into(), "say how deep the grating is"),
        }
    }

    /// Computes and writes the table.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        vacant(std::slice::from_ref(&self.out), self.force)?;
        let section = self.section()?;
        let light = Direction::light(self.light, 0.0)?;
        if let Some(bad) = self.wavelengths.0.iter().find(|nm| !(200.0..=2000.0).contains(*nm)) {
            return Err(Error::input("wavelengths", format!("hold {bad}"), "give numbers from 200 to 2000").into());
        }
        let depth_um = section.depth_um();
        let (mut orders, mut sums) = (vec![], [f64::INFINITY, f64::NEG_INFINITY]);
        for nm in &self.wavelengths.0 {
            let rows = self.at(&section, light, *nm)?;
            let sum: f64 = rows.iter().map(|r| r.efficiency).sum();
            sums = [sums[0].min(sum), sums[1].max(sum)];
            orders.extend(rows);
            check_rows(orders.len())?;
        }
        let mut csv = String::from("wavelength_nm,order,efficiency,theta_r_deg,flux\n");
        for r in &orders {
            let or_nan = |v: Option<f64>| v.unwrap_or(f64::NAN);
            let _ = writeln!(
                csv,
                "{},{},{:e},{:.6},{:e}",
                r.wavelength_nm,
                r.order,
                r.efficiency,
                or_nan(r.theta_r_deg),
                or_nan(r.flux)
            );
        }
        write_whole(&self.out, csv.as_bytes())?;
        let mut warnings = vec![];
        if sums[1] > 1.001 {
            warnings.push(format!("these orders add up to {:.2} times the light: this is too deep for them", sums[1]));
        }
        if self.period_um < 1.5 {
            warnings
                .push("the period is near to the wavelengths, where scalar theory is off by tens of percent".into());
        }
        let text = format!(
            "orders    {} rows, efficiencies add up to {:.6} to {:.6}\n{}wrote     {}",
            orders.len(),
            sums[0],
            sums[1],
            lines(&[], &warnings),
            self.out.display()
        );
        let report = Report { method: self.method, period_um: self.period_um, depth_um, sums, warnings, orders };
        console.result(&text, &report);
        Ok(())
    }

    /// All orders at a wavelength (nm) that propagate or hold more than 1e-9 of the reflected light.
    fn at(&self, section: &Section, light: Direction, nm: f64) -> Result<Vec<Row>, Error> {
        let k = TAU * 1e3 / nm;
        let mirror = 2.0 * k * light.z;
        let visible = ((1.0 + light.x) * self.period_um * 1e3 / nm).ceil() as usize;
        // Edges of the profile scatter into high orders; the orders beyond this bound hold less than 0.1 % of the
        // light.
        let most = (most_orders(mirror, section.depth_um()) + 200).max(visible);
        let all = section.efficiencies(mirror, most, self.method)?;
        let keep = |(m, efficiency): &(i32, f64)| *efficiency > 1e-9 || m.unsigned_abs() as usize <= visible;
        let rows = (-(most as i32)..=most as i32).zip(all).filter(keep).map(|(order, efficiency)| {
            let sin_r = f64::from(order) * nm * 1e-3 / self.period_um - light.x;
            let view = Direction::of(sin_r, 0.0);
            let flux = view.map(|view| {
                let pair = Pair::new(light, view);
                let own = section.efficiencies(k * pair.w, most, self.method);
                own.map(|e| e[(order + most as i32) as usize] * pair.gain)
            });
            Ok(Row {
                wavelength_nm: nm,
                order,
                efficiency,
                theta_r_deg: view.map(|v| v.x.asin().to_degrees()),
                flux: flux.transpose()?,
            })
        });
        rows.collect()
    }
}
