//! Frames per second, and fractions of the card's measured limits.

use super::scenes::{Files, MATERIALS, parsed, scene};
use super::{DEFAULT, Drawn, broken};
use crate::Machine;
use nacre_base::Result;
use nacre_plot::style::{FRAME, INK, SOFT, number};
use nacre_plot::svg::{Anchor, Area, Svg, fill};
use nacre_render::gpu::{Frames, Rates, frames, rates};
use serde::Serialize;

const FRAME_SIZE: [usize; 2] = [1920, 1080];
const MAPS: usize = 2048;

/// Left edges of the columns.
const COLUMNS: [f64; 6] = [28.0, 220.0, 370.0, 540.0, 690.0, 920.0];
const WIDTH: f64 = 1150.0;
const BAR: f64 = 120.0;
const ROW: f64 = 40.0;

/// All measured values.
#[derive(Serialize)]
struct Numbers {
    rates: Rates,
    materials: Vec<Named>,
}

#[derive(Serialize)]
struct Named {
    material: &'static str,
    #[serde(flatten)]
    frames: Frames,
}

/// Measures the frame rates and draws the table.
pub(super) fn draw(title: &str) -> Result<Drawn> {
    let files = Files::written(MAPS)?;
    let rates = rates()?;
    let measure = |material| {
        let scene = parsed(&scene(material, FRAME_SIZE, 1))?;
        Ok(Named { material: material.name, frames: frames(&scene, files.folder.path(), DEFAULT, &rates)? })
    };
    let materials = MATERIALS.iter().map(measure).collect::<Result<Vec<Named>>>()?;
    let machine = Machine::this();
    let measured = format!("Measured on {}, beside {} ({} threads).", rates.adapter, machine.cpu, machine.cores);
    let svg = table(title, &rates, &materials);
    let numbers = serde_json::to_string_pretty(&Numbers { rates, materials }).map_err(|e| broken("numbers", e))?;
    Ok(Drawn { svg, measured, numbers: Some(numbers) })
}

/// Placeholder for computers without a graphics card.
pub(super) fn nothing(title: &str) -> Drawn {
    let mut svg = Svg::new(WIDTH, 100.0);
    svg.text([COLUMNS[0], 34.0], title, 20.0, Anchor::Start, "font-weight=\"bold\"");
    let said = "There is no graphics card that can be used, or this program was built without the feature gpu: nothing was measured.";
    svg.text([COLUMNS[0], 66.0], said, 14.0, Anchor::Start, &fill(SOFT));
    Drawn::from(svg.finish(title))
}

fn table(title: &str, rates: &Rates, materials: &[Named]) -> String {
    let mut svg = Svg::new(WIDTH, 140.0 + ROW * materials.len() as f64);
    svg.text([COLUMNS[0], 34.0], title, 20.0, Anchor::Start, "font-weight=\"bold\"");
    let best = format!(
        "{}: copies {} GB/s, {} GFLOP/s of multiplications and additions",
        rates.adapter,
        number(1e-9 * rates.copied_bytes_per_s),
        number(1e-9 * rates.operations_per_s)
    );
    svg.text([COLUMNS[0], 60.0], &best, 14.0, Anchor::Start, &fill(SOFT));
    let titles = ["material", "frames/s", "operations/pixel", "texels/pixel", "of the operations", "of the copy"];
    for (x, title) in COLUMNS.iter().zip(titles) {
        svg.text([*x, 100.0], title, 13.0, Anchor::Start, "font-weight=\"bold\"");
    }
    svg.line([COLUMNS[0], 110.0], [WIDTH - 28.0, 110.0], &format!("stroke=\"{FRAME}\""));
    for (k, Named { material, frames }) in materials.iter().enumerate() {
        row(&mut svg, 136.0 + ROW * k as f64, material, frames);
    }
    svg.finish(title)
}

fn row(svg: &mut Svg, y: f64, material: &str, frames: &Frames) {
    let numbers = [frames.frames_per_s, frames.operations_per_pixel, frames.texels_per_pixel].map(number);
    for (x, text) in COLUMNS.iter().zip([material.to_owned()].into_iter().chain(numbers)) {
        svg.text([*x, y], &text, 13.0, Anchor::Start, &fill(INK));
    }
    for (x, share) in COLUMNS[4..].iter().zip([frames.of_operations, frames.of_copy]) {
        svg.rect(Area::new(*x, y - 12.0, BAR, 14.0), &format!("fill=\"none\" stroke=\"{FRAME}\""));
        svg.rect(Area::new(*x, y - 12.0, BAR * share.min(1.0), 14.0), "fill=\"#0072b2\"");
        let text = format!("{} %", number(100.0 * share));
        svg.text([x + BAR + 8.0, y], &text, 13.0, Anchor::Start, &fill(INK));
    }
}
