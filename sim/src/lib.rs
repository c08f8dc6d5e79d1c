//! The virtual bench: optics, samples, devices, noise and time, without hardware.
//!
//! It renders a fuller model than the reconstruction inverts (finite band, disc and aperture, Fresnel coefficients at
//! oblique incidence, front reflection, several orders, mixed dots, lens blur, noise), so that a good score is not
//! the same code run backwards.

mod bench;
mod blur;
mod camera;
mod config;
mod devices;
mod optics;
mod random;
mod scene;
mod session;
mod stage;
pub mod surface;

pub use bench::Bench;
pub use camera::{Exposed, Settings};
pub use config::{
    BenchConfig, CameraConfig, FilmConfig, FilterConfig, GeometryConfig, GratingConfig, PanelConfig, StageConfig,
};
pub use devices::{SharedBench, SimCamera, SimDisplay, SimStage, describe};
pub use scene::{Scene, StokesImage, Truth};
pub use session::{capture, write_session};
