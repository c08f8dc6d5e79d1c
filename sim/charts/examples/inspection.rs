//! Inspects simulated sheets: `inspection SEED SHEETS [KEY=VALUE…]`; prints recall, precision and false alarms.

use nacre_inspect::Parameters;
use nacre_sim_charts::inspection::Trial;
use std::collections::BTreeMap;

#[allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "an example")]
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, usual: u64| args.get(i).and_then(|a| a.parse().ok()).unwrap_or(usual);
    let (seed, sheets) = (number(0, 1), number(1, 50));
    let parameters = Parameters { false_alarms: 0.1, min_area_px: 4, max_turn_deg: 6.0, trained: None };
    let (mut planted, mut found, mut right, mut hits, mut wrong) = (0, 0, 0, 0, 0);
    let mut confusion: BTreeMap<String, usize> = BTreeMap::new();
    for k in 0..sheets as usize {
        let mut trial = Trial::of(k, seed);
        for arg in args.iter().skip(2) {
            let (key, value) = arg.split_once('=').unwrap();
            let value: f64 = value.parse().unwrap();
            match key {
                "well" => trial.well_e = value,
                "area" => trial.area_px = value,
                "count" => trial.count = value as usize,
                "pixels" => trial.pixels = value as u32,
                "turn" => trial.turn_deg = value,
                "shift" => trial.shift_mm = [value, 0.0],
                "kind" => trial.kind = nacre_sim_charts::inspection::KINDS[value as usize],
                _ => panic!("{key}"),
            }
        }
        // Captures are kept for another run if a folder is named.
        let temporary = tempfile::tempdir().unwrap();
        let kept = std::env::var_os("KEEP").map(|keep| std::path::Path::new(&keep).join(format!("{seed}-{k}")));
        let (judged, inspection) = match trial.judged(kept.as_deref().unwrap_or(temporary.path()), &parameters) {
            Ok(done) => done,
            Err(error) => {
                println!("{k:3} {:10} {error}", trial.kind.name());
                continue;
            }
        };
        let seen = judged.planted.iter().filter(|p| p.1.is_some()).count();
        for (defect, class) in &judged.planted {
            let name = class.map_or("-", |c| c.name());
            *confusion.entry(format!("{:?} -> {name}", defect.class)).or_default() += 1;
            let same = format!("{:?}", defect.class) == class.map_or(String::new(), |c| format!("{c:?}"));
            right += usize::from(same);
        }
        planted += judged.planted.len();
        found += seen;
        hits += judged.hits;
        wrong += judged.false_alarms;
        let r = &inspection.registration;
        println!(
            "{k:3} {:10} {seen}/{} false {} largest {:.1} of {:.2} misplaced {:.4}° {:.3} px {} edge {:.3} σ {:.4} px overlap {:.2} likeness {:.2} offset {:.3}±{:.3}° {:.2} s",
            trial.kind.name(),
            judged.planted.len(),
            judged.false_alarms,
            judged.largest[0],
            judged.largest[1],
            judged.misplaced[0],
            judged.misplaced[1],
            r.kind,
            r.edge,
            r.sigma_px,
            r.overlap,
            r.likeness,
            inspection.offset_deg,
            inspection.offset_sigma_deg,
            judged.seconds
        );
        if std::env::var_os("VERBOSE").is_some() {
            for defect in &inspection.regions.defects {
                println!("      {defect:?}");
            }
            for (defect, class) in &judged.planted {
                if class.is_none() {
                    let d = &inspection.differences;
                    let px = trial.pixels as f64;
                    let mm = trial.pixel_mm();
                    let (x, y) = (defect.at_mm[0] / mm + 0.5 * px - 0.5, 0.5 * px - 0.5 - defect.at_mm[1] / mm);
                    let mut best = (0.0_f32, 0);
                    for v in -2..=2_i64 {
                        for u in -2..=2_i64 {
                            let i = ((y.round() as i64 + v) * px as i64 + x.round() as i64 + u) as usize;
                            if d.statistic[i] >= best.0 {
                                best = (d.statistic[i], i);
                            }
                        }
                    }
                    let i = best.1;
                    println!(
                        "      MISSED at {x:.1} {y:.1} stat {:.2} off {:.4} sigma {:.4} ref {:.3} sample {:.3} light {:?}±{:?} compared {}",
                        best.0,
                        (d.sample[i] - d.reference[i]).norm(),
                        d.sigma[i],
                        d.reference[i].norm(),
                        d.sample[i].norm(),
                        d.light.value.get(i),
                        d.light.sigma.get(i),
                        d.compared[i]
                    );
                }
                println!(
                    "      planted {:?} at {:?} turn {:.0} period {:.2} -> {class:?}",
                    defect.class, defect.at_mm, defect.turn_deg, defect.period_factor
                );
            }
        }
    }
    println!(
        "seed {seed}: recall {:.4} ({found} of {planted}), precision {:.4}, {wrong} false alarms on {sheets} sheets, class right {:.4}",
        found as f64 / planted.max(1) as f64,
        hits as f64 / (hits + wrong).max(1) as f64,
        right as f64 / found.max(1) as f64
    );
    for (pair, count) in confusion {
        println!("  {pair}: {count}");
    }
}
