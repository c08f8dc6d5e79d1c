#![doc = include_str!("../README.md")]

mod bench;
mod blur;
mod camera;
mod config;
mod devices;
pub mod emulators;
mod fringes;
mod messages;
mod optics;
pub mod photographs;
mod port;
pub mod random;
mod scene;
mod sensor;
pub mod socket;
mod stage;
pub mod surface;
mod truth;

pub use bench::{Bench, Shining};
pub use camera::{Exposed, Settings};
pub use config::{
    AnalyserConfig, BenchConfig, CameraConfig, FaultConfig, FaultKind, FaultyDevice, FilmConfig, FilterConfig,
    FlashConfig, GeometryConfig, GratingConfig, PanelConfig, RigorousConfig, StageConfig,
};
pub use devices::{Port, SimDevice};
pub use fringes::Fringes;
pub use messages::{Devices, Reply, Request, describe};
pub use port::SharedBench;
pub use scene::{Lamp, Scene, Source, StokesImage, Truth};
pub use truth::write_truth;
