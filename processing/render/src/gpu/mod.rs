//! Rendering on a graphics card, natively and in the browser, from one shader source.
//!
//! The shaders ([`SHADER`], WGSL) render one plane, disc, cylinder, sphere or mesh under up to eight lights and an
//! environment. Materials are exact gratings with maps, slits, lookup tables over half vectors, height fields,
//! lattices, and a rough base. Inputs are uniforms and textures only ([`Prepared`]), so that naga's translation also
//! runs in WebGL2. All physical quantities are computed here by the processor's code; where both differ, the
//! processor's picture is the reference.

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

/// Name and backend of the best graphics card.
///
/// # Errors
/// The reason why there is none.
pub fn adapter() -> Result<String, String> {
    card::name()
}

/// Loads a scene onto a card, or returns the reason why that is not possible.
pub(super) fn card(prepared: &crate::prepared_scene::PreparedScene) -> Result<Card, String> {
    Card::new(Prepared::of(prepared, usize::MAX)?)
}

/// The shaders, with entry points `corner` (three vertices that cover the picture) and `light`.
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
