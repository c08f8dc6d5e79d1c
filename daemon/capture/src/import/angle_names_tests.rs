#![allow(clippy::unwrap_used)]

use super::*;

fn read(names: &[&str]) -> Result<Vec<f64>, String> {
    angles(&names.iter().map(PathBuf::from).collect::<Vec<_>>())
}

#[test]
fn names_that_are_understood() {
    let cases: [(&[&str], &[f64]); 43] = [
        (&["000.png", "045.png", "090.png"], &[0.0, 45.0, 90.0]),
        (&["run2_psi_0deg.tif", "run2_psi_22.5deg.tif"], &[0.0, 22.5]),
        (&["cd2_0_f8.png", "cd2_30_f8.png", "cd2_60_f8.png"], &[0.0, 30.0, 60.0]),
        (&["a1_15°.png", "a2_30°.png"], &[15.0, 30.0]),
        // Signs.
        (&["I_-45.png", "I_0.png", "I_45.png", "I_90.png"], &[-45.0, 0.0, 45.0, 90.0]),
        (&["I-45.png", "I0.png", "I45.png", "I90.png"], &[-45.0, 0.0, 45.0, 90.0]),
        (&["-45.png", "0.png", "45.png", "90.png"], &[-45.0, 0.0, 45.0, 90.0]),
        (&["-45.png", "+0.png", "+45.png", "+90.png"], &[-45.0, 0.0, 45.0, 90.0]),
        (&["I−45.png", "I0.png", "I45.png"], &[-45.0, 0.0, 45.0]),
        (&["I–45.png", "I0.png", "I45.png"], &[-45.0, 0.0, 45.0]),
        (&["I_m45.png", "I_0.png", "I_45.png", "I_90.png"], &[-45.0, 0.0, 45.0, 90.0]),
        (&["M45.png", "P00.png", "P45.png"], &[-45.0, 0.0, 45.0]),
        (&["n45.png", "p0.png", "p45.png"], &[-45.0, 0.0, 45.0]),
        (&["pol_neg45.png", "pol_pos0.png", "pol_pos45.png"], &[-45.0, 0.0, 45.0]),
        (&["minus_45.png", "plus_0.png", "plus_45.png"], &[-45.0, 0.0, 45.0]),
        (&["x_minus45deg.png", "x_0deg.png"], &[-45.0, 0.0]),
        (&["-30.png", "-60.png", "-90.png"], &[-30.0, -60.0, -90.0]),
        (&["x_-30.png", "x_-60.png", "x_-90.png"], &[-30.0, -60.0, -90.0]),
        (&["x-−30.png", "x-−60.png", "x-−90.png"], &[-30.0, -60.0, -90.0]),
        (&["minus30.png", "minus60.png", "minus90.png"], &[-30.0, -60.0, -90.0]),
        (&["x--45.png", "x-0.png", "x-45.png"], &[-45.0, 0.0, 45.0]),
        (&["-45.png", "45.png", "-45b.png"], &[-45.0, 45.0, -45.0]),
        // Dashes and letters that are not signs.
        (&["x-0.png", "x-45.png", "x-90.png", "x-135.png"], &[0.0, 45.0, 90.0, 135.0]),
        (&["sample-045.png", "sample-090.png"], &[45.0, 90.0]),
        (&["scan-2-045.png", "scan-2-000.png"], &[45.0, 0.0]),
        (&["scan2-045.png", "scan2-000.png"], &[45.0, 0.0]),
        (&["2024-01-15-0.png", "2024-01-15-45.png", "2024-01-15-90.png"], &[0.0, 45.0, 90.0]),
        (&["m0.png", "m45.png", "m90.png"], &[0.0, 45.0, 90.0]),
        (&["cam30.png", "cam60.png", "cam90.png"], &[30.0, 60.0, 90.0]),
        (&["p30.png", "p60.png", "p90.png"], &[30.0, 60.0, 90.0]),
        (&["H_0.png", "D_45.png", "V_90.png"], &[0.0, 45.0, 90.0]),
        (&["pos_-45.png", "pos_0.png", "pos_45.png"], &[-45.0, 0.0, 45.0]),
        // Decimals.
        (&["112,5.png", "157,5.png", "22,5.png", "67,5.png"], &[112.5, 157.5, 22.5, 67.5]),
        (&["-22p5.png", "0p0.png", "22p5.png"], &[-22.5, 0.0, 22.5]),
        (&["polm22p5.png", "polp22p5.png", "polp67p5.png"], &[-22.5, 22.5, 67.5]),
        (&["I0.png", "I22,5.png", "I45.png", "I67.5.png"], &[0.0, 22.5, 45.0, 67.5]),
        (&["000.5.png", "060.5.png"], &[0.5, 60.5]),
        (&["22,5°.png", "67,5 deg.png"], &[22.5, 67.5]),
        // Additional numbers.
        (&["IMG_0001_0.png", "IMG_0002_45.png", "IMG_0003_90.png"], &[0.0, 45.0, 90.0]),
        (&["45_10ms.png", "45_20ms.png", "0_10ms.png", "0_20ms.png"], &[45.0, 45.0, 0.0, 0.0]),
        (&["143022_0.png", "143025_45.png", "143101_90.png"], &[0.0, 45.0, 90.0]),
        (&["tilt30deg_0.png", "tilt30deg_45.png", "tilt30deg_90.png"], &[0.0, 45.0, 90.0]),
        (&["20°C_0.png", "22°C_45.png", "20°C_90.png"], &[0.0, 45.0, 90.0]),
    ];
    for (names, wanted) in cases {
        assert_eq!(read(names).as_deref(), Ok(wanted), "{names:?}");
    }
}

#[test]
fn names_that_are_refused() {
    let cases: [(&[&str], &str); 37] = [
        (&["IMG_0001.jpg", "IMG_0002.jpg", "IMG_0003.jpg"], "count"),
        (&["IMG_0001.jpg", "IMG_0002.jpg", "IMG_0004.jpg"], "count"),
        (&["IMG_4711.jpg", "IMG_4713.jpg"], "could be an angle"),
        (&["left.png", "right.png"], "all hold"),
        (&["1_10.png", "2_20.png"], "1 or 10"),
        (&["a.png", "10.png"], "all hold"),
        (&["0rad.png", "0.785rad.png", "1.571rad.png"], "degrees"),
        // Signs.
        (&["x_-0.png", "x_-45.png", "x_-90.png"], "45° or -45°"),
        (&["x -30.png", "x -60.png", "x -90.png"], "sign"),
        (&["x-0.png", "x-45.png", "x45.png"], "sign"),
        (&["I-45.png", "I_0.png", "I_90.png"], "sign"),
        (&["a - 45.png", "a 0.png", "a 90.png"], "sign"),
        (&["m30.png", "m60.png", "m90.png"], "sign"),
        (&["neg_30.png", "neg_60.png", "neg_90.png"], "sign"),
        (&["a-45.png", "b_0.png", "b_45.png"], "sign"),
        (&["neg. 45.png", "0.png", "90.png"], "sign"),
        (&["45neg.png", "0.png", "90.png"], "more to an angle"),
        (&["45-.png", "0.png", "90.png"], "more to an angle"),
        (&["45m.png", "0p.png", "90p.png"], "more to an angle"),
        (&["45cw.png", "45ccw.png", "0.png"], "more to an angle"),
        (&["cw45.png", "ccw45.png", "0.png"], "sign"),
        // Decimals.
        (&["22_5.png", "67_5.png", "112_5.png"], "22 or 22.5"),
        (&["22-5.png", "67-5.png", "112-5.png"], "22 or 22.5"),
        (&["22d5.png", "67d5.png", "112d5.png"], "22 or 22.5"),
        (&["0_0.png", "22_5.png", "45_0.png", "67_5.png"], "several"),
        (&["0.png", "22_5.png", "45.png", "67_5.png"], "all hold"),
        (&["22_5deg.png", "67_5deg.png", "112_5deg.png"], "22 or 22.5"),
        (&["22_5deg.png", "45_0deg.png", "67_5deg.png"], "22.5"),
        (&["0deg.png", "22_5deg.png", "45deg.png"], "22.5"),
        (&["22°30'.png", "67°30'.png"], "22.30"),
        (&["22½.png", "67½.png"], "more to an angle"),
        (&["psi_.5.png", "psi_.75.png", "psi_90.png"], "more to an angle"),
        (&["psi_.5.png", "psi_.75.png"], "more to an angle"),
        (&["1e2.png", "5e1.png", "9e1.png"], "several"),
        (&["I1,0.png", "I1,45.png", "I1,90.png"], "1.45"),
        (&["1.0.png", "2.45.png", "3.90.png", "4.135.png"], "count"),
        (&["I0m45.png", "I0p45.png", "I0p90.png"], "all hold"),
    ];
    for (names, why) in cases {
        let refused = read(names).expect_err(&format!("{names:?}"));
        assert!(refused.contains(why), "{names:?}: {refused}");
    }
}

/// Any series, written in any supported style, is parsed correctly.
#[test]
fn angles_are_read_back_from_every_style() {
    let series: [&[f64]; 6] = [
        &[0.0, 45.0, 90.0, 135.0],
        &[-45.0, 0.0, 45.0, 90.0],
        &[-67.5, -22.5, 22.5, 67.5],
        &[0.0, 22.5, 45.0, 67.5, 90.0, 112.5, 135.0, 157.5],
        &[-90.0, -11.25, 12.375, 180.0, 359.5],
        &[30.0, 90.0, 150.0],
    ];
    let signs =
        [["-", ""], ["-", "+"], ["−", ""], ["m", ""], ["m", "p"], ["n", ""], ["neg", "pos"], ["minus_", "plus_"]];
    let mut tried = 0;
    for angles in series {
        for [minus, plus] in signs {
            for mark in [".", ",", "p"] {
                for width in [0, 3] {
                    for (before, after) in [
                        ("", ""),
                        ("I", ""),
                        ("I_", ""),
                        ("psi=", "deg"),
                        ("pol ", "°"),
                        ("cd2_", "_f8"),
                        ("run-2_", "_10ms"),
                        ("2024-01-15_", " deg_v3"),
                        ("IMG#_", ""),
                    ] {
                        let name = |(k, angle): (usize, &f64)| {
                            let sign = if *angle < 0.0 { minus } else { plus };
                            let number = format!("{:0width$}", angle.abs().trunc());
                            let fraction = format!("{}", angle.abs());
                            let fraction =
                                fraction.split_once('.').map_or(String::new(), |(_, f)| format!("{mark}{f}"));
                            let before = before.replace('#', &format!("_{:04}", 17 + k));
                            PathBuf::from(format!("{before}{sign}{number}{fraction}{after}.png"))
                        };
                        let names: Vec<PathBuf> = angles.iter().enumerate().map(name).collect();
                        assert_eq!(super::angles(&names).as_deref(), Ok(angles), "{names:?}");
                        tried += 1;
                    }
                }
            }
        }
    }
    assert_eq!(tried, 6 * 8 * 3 * 2 * 9);
}

/// No combination of names causes a panic.
#[test]
fn any_names_are_read_or_refused() {
    let pieces = ["", "-", "45", "−", ".", "5", "deg", "_", "é", "½", "p", "°"];
    for a in pieces {
        for b in pieces {
            for c in pieces {
                let (one, other) = (format!("{a}{b}{c}.png"), format!("{c}{a}{b}.png"));
                let _ = read(&[&one, &other]);
            }
        }
    }
    assert!(read(&[]).is_err());
}
