//! The same pictures on a graphics card, natively and in the browser, from one source of shaders.
//!
//! The shaders ([`SHADER`], WGSL) render one plane, disc, cylinder, sphere or mesh under up to eight lights and an environment: exact gratings with maps, slits,
//! tables over half vectors, height fields and lattices, and a rough base. They take nothing but uniforms and textures ([`Prepared`]), so that naga's translation runs in WebGL2 as well.
//! What is physics is computed here, by the processor's own code; where both differ, the processor is right.

mod alias;
#[cfg(feature = "gpu")]
mod card;
#[cfg(not(feature = "gpu"))]
#[path = "none.rs"]
mod card;
mod prepared;
mod repeating;
mod speed;
mod texture;
mod textures;
mod under;

pub(super) use card::Card;
pub use prepared::{NAMES, Prepared};
pub use speed::{Frames, Kept, Rates, Timed, frames, rates, timed};
pub use texture::Texture;

/// What the best graphics card is called and how it is reached.
///
/// # Errors
/// Says why there is none.
pub fn adapter() -> Result<String, String> {
    card::name()
}

/// A card with a scene on it, or why there is none.
pub(super) fn card(ready: &crate::prepared_scene::PreparedScene) -> Result<Card, String> {
    Card::new(Prepared::of(ready, usize::MAX)?)
}

/// The shaders: entry points `corner` (three vertices that cover all) and `light`.
pub const SHADER: &str = concat!(
    include_str!("scene.wgsl"),
    include_str!("shape.wgsl"),
    include_str!("grating.wgsl"),
    include_str!("slits.wgsl"),
    include_str!("field.wgsl"),
    include_str!("surface.wgsl"),
    include_str!("environment.wgsl"),
    include_str!("heights.wgsl"),
    include_str!("corner.wgsl"),
    include_str!("light.wgsl")
);
