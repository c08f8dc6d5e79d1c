//! Consistency of the page's angle colours with the service's pictures. `palette.js` is a table generated from
//! `nacre_image::Palette`; the shader's function is evaluated by naga and compared with it.

use nacre_image::Palette;
use naga::{Expression, Literal};
use std::error::Error;
use std::f64::consts::PI;
use std::path::Path;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Number of colours in the table: steps of 0.5°, whose differences are invisible.
const COLORS: usize = 360;
/// Command that regenerates the table.
const UPDATE: &str = "run NACRE_UPDATE=1 cargo test -p nacre-web --test palette";

#[test]
fn script_of_the_page_holds_the_palette() -> Result<()> {
    let color = |i: usize| Palette::Cyclic.color((PI * i as f64 / COLORS as f64) as f32);
    let text = |[r, g, b]: [u8; 3]| format!("{r:02x}{g:02x}{b:02x}");
    let colors: Vec<String> = (0..COLORS).map(|i| text(color(i))).collect();
    let script = format!(
        "// Made from processing/image/src/palette.rs; see web/tests/palette.rs.\n\
         /** Colours of angles from 0° up to 180°, in even steps. */\n\
         export const CYCLIC = \"{}\".split(\" \");\n",
        colors.join(" ")
    );
    let path = Path::new("page/palette.js");
    if std::env::var_os("NACRE_UPDATE").is_some() {
        std::fs::write(path, script)?;
    } else if std::fs::read_to_string(path)? != script {
        return Err(format!("web/page/palette.js is not up to date; {UPDATE}").into());
    }
    Ok(())
}

#[test]
fn shader_has_the_palette() -> Result<()> {
    let source = std::fs::read_to_string("../processing/render/src/gpu/light.wgsl")?;
    let body = source.split_once("fn cyclic(turns: f32) -> vec3<f32> {").ok_or("light.wgsl has no function cyclic")?.1;
    let body = body.split_once("\n}").ok_or("the function cyclic has no end")?.0;
    for deg in (-180..360).step_by(7) {
        let turns = f64::from(deg) / 180.0;
        let theta = (PI * turns) as f32;
        let found = evaluated(body, turns)?.map(|light| (255.0 * srgb(light)).round() as i32);
        let wanted = Palette::Cyclic.color(theta).map(i32::from);
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= 1), "{deg}°: {found:?}, not {wanted:?}");
    }
    Ok(())
}

/// Evaluates a shader function's body at `turns` with naga, after replacing its variables by constants.
fn evaluated(body: &str, turns: f64) -> Result<[f64; 3]> {
    let body = body.replace("let ", "const ").replace("return ", "const result = ");
    let module = naga::front::wgsl::parse_str(&format!("const turns: f32 = {turns:?};\n{body}"))?;
    let (_, result) =
        module.constants.iter().find(|(_, c)| c.name.as_deref() == Some("result")).ok_or("there is no result")?;
    let Expression::Compose { components, .. } = &module.global_expressions[result.init] else {
        return Err("the result is no vector".into());
    };
    let number = |at: &naga::Handle<Expression>| match module.global_expressions[*at] {
        Expression::Literal(Literal::F32(value)) => Ok(f64::from(value)),
        Expression::Literal(Literal::AbstractFloat(value)) => Ok(value),
        ref other => Err(format!("{other:?} is no number")),
    };
    let numbers: Vec<f64> = components.iter().map(number).collect::<std::result::Result<_, _>>()?;
    numbers.try_into().map_err(|_| "the result has not three numbers".into())
}

/// sRGB transfer function (IEC 61966-2-1).
fn srgb(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}
