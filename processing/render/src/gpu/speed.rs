//! Rendering speed of a card, relative to the processor and to the card's peak rates.

use super::{Card, Prepared, SHADER, Texture, card};
use crate::material::SAMPLES;
use crate::material::shading::Accuracy;
use crate::picture::Picture;
use crate::prepared_scene::PreparedScene;
use crate::scene::Scene;
use crate::settings::Settings;
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// Adds a texture to the picture: measures memory bandwidth.
const COPY: &str = "
@group(0) @binding(1) var source: texture_2d<f32>;
fn drawn(corner: vec2<f32>) -> vec4<f32> {
    return textureLoad(source, vec2<i32>(corner), 0);
}";

/// Side in pixels of the copied texture, on a card and in software: larger than the caches, and long compared with the
/// overhead of a frame.
const COPIED: [usize; 2] = [4096, 2048];

/// Bytes of a texel and of a picture pixel, which is read and written.
const TEXEL: f64 = 16.0;
const ADDED_UP: f64 = 2.0 * TEXEL;

/// Multiplies and adds four vectors of four per iteration: measures arithmetic throughput.
const ADD: &str = "
fn drawn(corner: vec2<f32>) -> vec4<f32> {
    var a = vec4(corner, 0.5, 1.0);
    let by = 0.999 + 1e-7 * a;
    var b = a.yzwx; var c = a.zwxy; var d = a.wxyz;
    for (var k = 0; k < 1024; k++) {
        a = fma(a, by, by); b = fma(b, by, by); c = fma(c, by, by); d = fma(d, by, by);
    }
    return a + b + c + d;
}";

/// Side in pixels, on a card and in software, and operations per pixel.
const ADDED: [usize; 2] = [2048, 256];
const ADDED_OPERATIONS: f64 = 1024.0 * 4.0 * 4.0 * 2.0;

/// Shader lines and the number of operations from each of them to the next loop. Additions, multiplications, roots and
/// similar functions count as one, as read from the source. The counts are accurate to about a fifth, since compilers
/// remove some operations.
const OPERATIONS: [(&str, u32); 20] = [
    ("let slope = dot(ray, scene.normal.xyz);", 80),
    ("let axis = scene.normal.xyz;", 120),
    ("let off = o + ray * middle;", 80),
    ("let low = mesh_texel(2 * index);", 40),
    ("let h = cross(ray, q);", 50),
    ("let c = covariance(light, width, clamp(found.x, FIRST, LAST));", 60),
    ("let sum = cosines.x + cosines.y;", 38),
    ("sum += matrix[k * FOURS + n] * rows[k];", 8),
    ("sum += dot(matrix[k * FOURS + n], columns[n]);", 8),
    ("sum += dot(columns[n], matrix[k * FOURS + n]);", 8),
    ("let number = start + apart * f32(k);", 90),
    ("let nu = start + apart * f32(k);", 180),
    ("let tile = vec2(n % across, n / across) * side;", 60),
    ("let power = frequency_power(bin, number, w, view.z);", 110),
    ("let by = mix(", 18),
    ("let aligned = 1.0 + dot(view, light);", 120),
    ("let facets = distribution / (", 200),
    ("let own = rough_drawn(view, u);", 320),
    ("let exact = -(view.xy + f32(n) * g);", 170),
    ("let off = (at - vec2<f32>(bin)) / s;", 380),
];

/// Counters of the counting shader, and the output of their values.
const COUNTED: &str = "
var<private> counted: vec2<f32>;
fn counted_load(source: texture_2d<f32>, at: vec2<i32>, level: i32) -> vec4<f32> {
    counted.y += 1.0;
    return textureLoad(source, at, level);
}";
const MEAN: &str = "let mean = sum / max(f32(count), 1.0);";

/// Reduction of the frame along each side for software renderers.
const SHARE: usize = 8;

/// Minimum duration of a measurement in s.
const LONG: f64 = 0.25;

/// Peak rates of a card, measured with shaders that do nothing else.
#[derive(Clone, Debug, Serialize)]
pub struct Rates {
    /// Name and backend of the card.
    pub adapter: String,
    /// Whether it is a software renderer.
    pub software: bool,
    /// Copy bandwidth in bytes per second, reads and writes counted.
    pub copied_bytes_per_s: f64,
    /// Additions and multiplications of 32-bit floats per second.
    pub operations_per_s: f64,
}

/// Rendering speed of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Frames {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Size of the drawn central part in pixels; times are scaled to the whole frame.
    pub drawn: [usize; 2],
    /// Whole frames per second with one sample per pixel.
    pub frames_per_s: f64,
    /// Counted operations per pixel.
    pub operations_per_pixel: f64,
    /// Texels read per pixel, of 16 bytes at most, mostly from caches.
    pub texels_per_pixel: f64,
    /// Bytes per pixel that must pass through memory: the texel of the maps, if there are any, and the sum of its
    /// samples, read and written.
    pub bytes_per_pixel: f64,
    /// Fraction of the card's peak arithmetic rate.
    pub of_operations: f64,
    /// Fraction of the copy bandwidth.
    pub of_copy: f64,
}

/// A picture and its computing time.
#[derive(Clone, Debug)]
pub struct Timed {
    /// Linear sRGB, row by row from the top.
    pub pixels: Vec<[f32; 3]>,
    /// Time of the samples in s, without preparation of the scene.
    pub seconds: f64,
}

fn refused(why: String) -> Error {
    Error::input("gpu", why, "render on the processor")
}

/// The best card, kept from scene to scene so that scenes with the same shaders compile them once.
#[derive(Default)]
pub struct Kept(Option<Card>);

impl Kept {
    /// Loads a scene onto the card, or returns the reason why that is not possible.
    fn with(&mut self, prepared: &PreparedScene) -> std::result::Result<&mut Card, String> {
        match &mut self.0 {
            Some(card) => card.load(Prepared::of(prepared, usize::MAX)?)?,
            none => *none = Some(card(prepared)?),
        }
        self.0.as_mut().ok_or_else(|| "there is no card".into())
    }
}

/// Renders a scene with `samples` samples per pixel (a multiple of 4) and relative truncation error `error`, on a card
/// or, without one, on the processor. The scene's files are in `folder`.
///
/// # Errors
/// `Input` for invalid scenes, and if no card supports the scene.
pub fn timed(scene: &Scene, folder: &Path, samples: usize, error: f64, card: Option<&mut Kept>) -> Result<Timed> {
    Settings { samples, ..Settings::default() }.check()?;
    let prepared = PreparedScene::new(scene, folder, Accuracy::new(error, None), &Silent)?;
    let passes = (samples / SAMPLES).max(1);
    if let Some(kept) = card {
        let card = kept.with(&prepared).map_err(refused)?;
        // Drivers compile shaders at the first draw.
        card.seconds(1, [1, 1]).map_err(refused)?;
        let begun = Instant::now();
        let pixels = card.pass(0, passes * SAMPLES).map_err(refused)?;
        return Ok(Timed { pixels, seconds: begun.elapsed().as_secs_f64() });
    }
    let mut picture = Picture::new(prepared.size());
    let begun = Instant::now();
    for _ in 0..passes {
        picture.add(&prepared, &Silent)?;
    }
    let pixels = picture.pixels.iter().map(|p| p.rgb.map(|v| v as f32)).collect();
    Ok(Timed { pixels, seconds: begun.elapsed().as_secs_f64() })
}

/// Time of a frame in s, averaged over as many frames as the measurement requires.
fn pace(card: &mut Card, part: [usize; 2]) -> std::result::Result<f64, String> {
    card.seconds(1, part)?;
    let mut frames = 1;
    loop {
        let seconds = card.seconds(frames, part)?;
        if seconds > LONG || frames >= 4096 {
            return Ok(seconds / frames as f64);
        }
        frames *= 2;
    }
}

/// Pixels per second of a shader that reads a single texture; the two sizes are for cards and for software.
fn probe(shader: &str, [of_card, of_software]: [usize; 2]) -> std::result::Result<(f64, Card), String> {
    let prepared = |side: usize| {
        let values = vec![0.5; 4 * side * side];
        let texture = Texture { name: "source", width: side, height: side, channels: 4, values };
        Prepared { size: [side; 2], uniforms: vec![[0.0; 4]], textures: vec![texture] }
    };
    let mut card = Card::with(prepared(of_software), shader)?;
    let side = if card.software() { of_software } else { of_card };
    card.load(prepared(side))?;
    let seconds = pace(&mut card, [side; 2])?;
    Ok(((side * side) as f64 / seconds, card))
}

/// Peak rates of the best card.
///
/// # Errors
/// `Input` if there is none.
pub fn rates() -> Result<Rates> {
    let (copied, card) = probe(COPY, COPIED).map_err(refused)?;
    let (added, _) = probe(ADD, ADDED).map_err(refused)?;
    Ok(Rates {
        adapter: card.name().to_owned(),
        software: card.software(),
        copied_bytes_per_s: copied * (TEXEL + ADDED_UP),
        operations_per_s: added * ADDED_OPERATIONS,
    })
}

/// The shaders with counters of operations and texels in place of light.
fn counting() -> String {
    let mut source = SHADER.replace("textureLoad(", "counted_load(") + COUNTED;
    for (line, operations) in OPERATIONS {
        source = source.replace(line, &format!("counted.x += {operations}.0; {line}"));
    }
    source.replace(MEAN, "let mean = vec4(counted / max(f32(count), 1.0), 0.0, 1.0);")
}

/// Measures the frame rate of a scene whose files are in `folder`; the relative truncation error of sums is `error`.
///
/// # Errors
/// `Input` for invalid scenes, and if no card supports the scene.
pub fn frames(scene: &Scene, folder: &Path, error: f64, rates: &Rates) -> Result<Frames> {
    let prepared = Prepared::new(scene, folder, error, usize::MAX, &Silent)?;
    measured(prepared, rates).map_err(refused)
}

fn measured(prepared: Prepared, rates: &Rates) -> std::result::Result<Frames, String> {
    let size = prepared.size;
    let drawn = if rates.software { size.map(|n| n.div_ceil(SHARE)) } else { size };
    let maps = prepared.textures.iter().any(|t| t.name == "maps" && t.width > 2);
    let bytes_per_pixel = ADDED_UP + if maps { TEXEL } else { 0.0 };
    let counts = Card::with(prepared.clone(), &counting())?.part(0, 1, drawn)?;
    let pixels = (drawn[0] * drawn[1]) as f64;
    let mean = |c: usize| counts.iter().map(|p| f64::from(p[c])).sum::<f64>() / pixels;
    let pixels_per_s = pixels / pace(&mut Card::new(prepared)?, drawn)?;
    Ok(Frames {
        size,
        drawn,
        frames_per_s: pixels_per_s / (size[0] * size[1]) as f64,
        operations_per_pixel: mean(0),
        texels_per_pixel: mean(1),
        bytes_per_pixel,
        of_operations: mean(0) * pixels_per_s / rates.operations_per_s,
        of_copy: bytes_per_pixel * pixels_per_s / rates.copied_bytes_per_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each counted line occurs exactly once in the shaders, so that a changed shader requires a new count.
    #[test]
    fn lines_that_count_are_there() {
        for (line, _) in OPERATIONS.into_iter().chain([(MEAN, 0)]) {
            assert_eq!(SHADER.matches(line).count(), 1, "{line}");
        }
    }
}
