//! `nacre schema`.

use crate::console::Console;
use clap::ValueEnum;
use nacre_capture::Failure;
use nacre_frames::FrameSet;
use nacre_sim::BenchConfig;

/// Arguments of `nacre schema`.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  nacre schema frames > frames.schema.json")]
pub struct Args {
    /// The file format.
    name: Name,
}

#[derive(Clone, Copy, ValueEnum)]
enum Name {
    /// frames.json: set of photographs.
    Frames,
    /// plan.toml: capture plan.
    Plan,
    /// bench.toml: simulated bench.
    Bench,
    /// geometry.json: poses of camera, sample, panel and light.
    Geometry,
    /// Scene of `nacre render`.
    Scene,
    /// nacre.toml: configuration of bench and service.
    Config,
    /// REST interface of the service, as an OpenAPI document.
    Openapi,
}

/// Prints the schema, which is JSON with and without `--json`.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let schema = match args.name {
        Name::Frames => schemars::schema_for!(FrameSet),
        Name::Plan => schemars::schema_for!(nacre_capture::plan::Plan),
        Name::Bench => schemars::schema_for!(BenchConfig),
        Name::Geometry => schemars::schema_for!(nacre_optics::geometry::Geometry),
        Name::Scene => schemars::schema_for!(nacre_render::Scene),
        Name::Config => schemars::schema_for!(nacre_service::config::Config),
        Name::Openapi => {
            let document = nacre_service::openapi();
            console.result(&serde_json::to_string_pretty(&document).unwrap_or_default(), &document);
            return Ok(());
        }
    };
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    console.result(&text, &schema);
    Ok(())
}
