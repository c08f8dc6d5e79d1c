// What the host tells the shader: four numbers each, so that every API lays them out alike. Lengths in mm, angles in rad, periods in µm,
// wave numbers in 1/µm. `prepared.rs` fills them in.
struct Scene {
    eye: vec4<f32>,      // camera; half the picture's height at distance 1
    right: vec4<f32>,    // of the picture; its width in pixels
    up: vec4<f32>,       // of the picture; its height in pixels
    ahead: vec4<f32>,    // of the camera
    center: vec4<f32>,   // of the shape; half its width (of a cylinder: its length; of a sphere: its radius)
    across: vec4<f32>,   // direction of u (where a cylinder's angles start); half its height (radius)
    along: vec4<f32>,    // direction of v (a quarter turn on); radius of its hole (first angle)
    normal: vec4<f32>,   // of its front (axis); radius, 0 for a rectangle (below 0: the cylinder's angle)
    form: vec4<f32>,     // 0 a plane or disc, 1 a part of a cylinder, 2 a sphere, 3 a mesh; its nodes
    what: vec4<f32>,     // 0 nothing, 1 grating, 2 table, 3 slits, 4 rectangles, 5 heights diffract; lights; what is shown; coverage
    same: vec4<f32>,     // orientation and period; 1 where maps have them
    grooves: vec4<f32>,  // how often maps repeat along u and v; 1 around the middle of a disc; variance of a lobe in 1/µm²
    relief: vec4<f32>,   // rows of `powers` per 1/µm of q; highest order of `powers`; highest order that counts; whether m and -m have the same power. Heights under a sky: cells of `under_top` along x and y, frequencies along a side of one, variance of a lobe in 1/µm²
    sums: vec4<f32>,     // step and reach in standard deviations of a lobe; most rounds of balancing; how near sums get to 1
    table: vec4<f32>,    // extent, warp, scale; 1 without loss
    repeat: vec4<f32>,   // µm after which it repeats, along x and y; highest frequencies that count, in cycles of it
    turn: vec4<f32>,     // direction of its x: cosine and sine; heights: pairs of terms, half their range in µm
    detail: vec4<f32>,   // slits: width, how many, their share; rectangles: sides, their share squared; heights: rows of `phases` per unit of X, 1 without loss, views and wave numbers of `norm`
    albedo: vec4<f32>,   // of the base; roughness, 0 without a base
    specular: vec4<f32>, // of the base; 1 where the base lies below the top and gets what its Fresnel reflectance lets through
    sky_x: vec4<f32>,    // axes of the sky's picture; 1 where there is one,
    sky_y: vec4<f32>,    // 1 where it is seen behind the shape,
    sky_z: vec4<f32>,    // largest step of sums over its spectrum
    range: vec4<f32>,    // of the period and of σ where they are shown as colours
    samples: vec4<f32>,  // first sample of a pixel, how many, and the part that earlier ones have in the result
    // Eight of five: place, σ; intensity, 1 if far and 2 if a rectangle, first wave number, step; linear sRGB, largest step of sums; beam, or half
    // of a rectangle's width as a vector; half of its height
    lights: array<vec4<f32>, 40>,
}

@group(0) @binding(0) var<uniform> scene: Scene;
// Orientation, period, σ of the orientation, and 1 where they are known; row 0 on top.
@group(0) @binding(1) var maps: texture_2d<f32>;
// X, Y, Z per wave number, a row per light.
@group(0) @binding(2) var spectra: texture_2d<f32>;
// Powers of orders (columns) over q times depth (rows), of scalar theory.
@group(0) @binding(3) var powers: texture_2d<f32>;
// Reflectance over the cosine (columns) and wave numbers (rows).
@group(0) @binding(4) var mirror: texture_2d<f32>;
// A table over half vectors, linear sRGB; and its albedo over sines of view.
@group(0) @binding(5) var half_vectors: texture_2d<f32>;
@group(0) @binding(6) var half_albedo: texture_2d<f32>;
// What a rough surface reflects, over cosines and roughness: see base.rs.
@group(0) @binding(7) var rough: texture_2d<f32>;
// What a height field repeats: amplitudes of pairs of terms over frequencies (tiles, the lowest first), terms' functions of X (rows), and what its
// BRDF gives back over views (tiles, one for each wave number): see repeating.rs.
@group(0) @binding(8) var terms: texture_2d<f32>;
@group(0) @binding(9) var phases: texture_2d<f32>;
@group(0) @binding(10) var norm: texture_2d<f32>;
// Light from everywhere, a lat-long picture in linear sRGB with the density of its draws, then what they are drawn by (see under.rs); and X, Y, Z per wave number of its red, green and blue (rows).
@group(0) @binding(11) var sky: texture_2d<f32>;
@group(0) @binding(12) var sky_colors: texture_2d<f32>;
// What a table and the base show of it over the sines of view, linear sRGB: see under.rs.
@group(0) @binding(13) var under_top: texture_2d<f32>;
@group(0) @binding(14) var under_base: texture_2d<f32>;
// A mesh: nodes (low, the other child or the first triangle; high, triangles), then triangles, three texels for each corner: see mesh.rs.
@group(0) @binding(15) var mesh: texture_2d<f32>;
// The picture of the samples before.
@group(0) @binding(16) var before: texture_2d<f32>;

const LIGHT_ROWS: i32 = 5;
const PI: f32 = 3.14159265;
// Wave numbers that are seen: those of 780 and 380 nm.
const FIRST: f32 = 1.28205128;
const LAST: f32 = 2.63157895;

// Between four texels, in texels; edges go on.
fn smooth_at(texture: texture_2d<f32>, at: vec2<f32>) -> vec4<f32> {
    let last = vec2<i32>(textureDimensions(texture)) - 1;
    let low = clamp(vec2<i32>(floor(at)), vec2(0), max(last - 1, vec2(0)));
    let high = min(low + 1, last);
    let t = clamp(at - vec2<f32>(low), vec2(0.0), vec2(1.0));
    let top = mix(textureLoad(texture, low, 0), textureLoad(texture, vec2(high.x, low.y), 0), t.x);
    let bottom = mix(textureLoad(texture, vec2(low.x, high.y), 0), textureLoad(texture, high, 0), t.x);
    return mix(top, bottom, t.y);
}
