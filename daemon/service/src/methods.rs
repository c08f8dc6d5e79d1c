//! What each method of `/api/v1/reconstructions` refuses and does.

use super::problem::{Answer, Problem};
use super::work::result_folder;
use nacre_base::Error;
use nacre_base::estimate::Work;
use nacre_base::progress::Progress;
use nacre_capture::plan::Method;
use nacre_frames::hdr;
use nacre_frames::{FILE_NAME, load};
use nacre_lut::bokeh;
use nacre_lut::foil;
use nacre_maps::Maps;
use nacre_optics::color;
use nacre_periods::calibration;
use nacre_periods::flash;
use nacre_periods::spots;
use nacre_render::Glimpse;
use nacre_store::jobs::Spec;
use std::path::{Path, PathBuf};

/// Checks a job's input and options, and estimates it. `uploads` is the service's folder of uploads.
pub fn check(spec: &Spec, input: &Path, uploads: &Path) -> Answer<Work> {
    let whole = || {
        if input.join(FILE_NAME).exists() {
            return Ok(());
        }
        Err(Problem::not_found("complete set of photographs there").remedy("finish the session first"))
    };
    if let Some(light) = &spec.light {
        if spec.method != Method::Lut {
            return Err(Problem::bad("light, the photograph of one, belongs to the method lut"));
        }
        if !uploads.join(&light.upload).is_dir() {
            return Err(Problem::not_found(format!("upload {} with a light", light.upload)));
        }
    }
    match spec.method {
        Method::Polarization => {
            whole()?;
            if spec.options.is_some() {
                return Err(Problem::bad("options do not belong to the method polarization, which has its own"));
            }
            let frames = load(input)?;
            let options = spec.polarization()?;
            options.check(&frames)?;
            Ok(options.work(&frames)?)
        }
        Method::Hdr => {
            if spec.session.is_some() {
                whole()?;
            }
            spec.options_of::<hdr::Options>()?;
            Ok(hdr::check_input(input)?)
        }
        Method::Lut => {
            if spec.session.is_some() {
                whole()?;
            }
            let settings = spec.table(uploads)?;
            // A file of the service's machine is nobody's business.
            if !color::NAMES.contains(&settings.illuminant.as_str()) {
                return Err(Problem::bad(format!("illuminant is none of {}", color::NAMES.join(", "))));
            }
            Ok(nacre_lut::check_input(input, &settings)?)
        }
        Method::Foil => {
            if spec.session.is_some() {
                whole()?;
            }
            Ok(foil::check_input(input, &spec.options_of()?)?)
        }
        Method::Calibrate => {
            if spec.session.is_some() {
                return Err(Problem::bad(
                    "method calibrate takes photographs of a board; give an upload, not a session",
                ));
            }
            let options: calibration::Options = spec.options_of()?;
            options.check()?;
            if spec.upload.is_none() && !options.needs_no_photographs() {
                return Err(Problem::bad("there are no photographs").remedy("give an upload that holds them"));
            }
            Ok(calibration::work(input, spec.upload.is_some()))
        }
        Method::Map => {
            let maps = Maps::read(&maps_of(spec, input))?;
            spec.options_of::<nacre_maps::Edits>()?.check(&maps)?;
            Ok(maps.work())
        }
        Method::Flash => {
            whole()?;
            Ok(flash::check_input(input, &spec.options_of()?)?)
        }
        Method::Brdf => {
            let options: nacre_brdf::MapOptions = spec.options_of()?;
            // A file of the service's machine is nobody's business.
            if !color::NAMES.contains(&options.settings.illuminant.as_str()) {
                return Err(Problem::bad(format!("illuminant is none of {}", color::NAMES.join(", "))));
            }
            if spec.session.is_some() {
                return Err(Problem::bad("method brdf takes a height field; give an upload, not a session"));
            }
            Ok(options.check(input)?)
        }
        Method::Spots => {
            whole()?;
            let settings: spots::Settings = spec.options_of()?;
            Ok(spots::check_input(input, &settings)?)
        }
        Method::Bokeh => {
            if spec.session.is_some() {
                whole()?;
            }
            let options: bokeh::Options = spec.options_of()?;
            // A file of the service's machine is nobody's business.
            if matches!(options.psf, bokeh::PsfChoice::Image(_)) {
                return Err(Problem::bad("psf: an image of a point is for the command line; give {\"sigma\": PX}"));
            }
            Ok(bokeh::check_input(input, &options)?)
        }
        Method::Render => {
            if spec.session.is_some() {
                return Err(Problem::bad("method render takes a scene; give an upload, not a session"));
            }
            let options = spec.options_of()?;
            Ok(nacre_render::work(&nacre_render::check_folder(input, &options)?, &options))
        }
    }
}

/// Where the maps are: uploaded, or what a session found.
fn maps_of(spec: &Spec, input: &Path) -> PathBuf {
    if spec.session.is_some() { input.join("results") } else { input.to_path_buf() }
}

/// Names a file as whoever sent it does: without the folder that it is in here.
fn as_sent(error: Error, folder: &Path) -> Error {
    match error {
        Error::Input { subject, problem, remedy } => {
            let name = Path::new(&subject).strip_prefix(folder).map(|file| file.display().to_string());
            Error::Input { subject: name.unwrap_or(subject), problem, remedy }
        }
        other => other,
    }
}

/// Does a job of the service whose data folder this is. What there is to see of a rendering goes to `seen`.
///
/// # Errors
/// As the method answers.
pub fn perform(data: &Path, spec: &Spec, progress: &dyn Progress, seen: &mut dyn FnMut(Glimpse)) -> Result<(), Error> {
    let input = match (&spec.session, &spec.upload) {
        (Some(id), _) => data.join("sessions").join(id),
        (None, Some(id)) => data.join("uploads").join(id),
        // It may go on from an earlier one, without photographs.
        _ if spec.method == Method::Calibrate => PathBuf::new(),
        _ => return Err(Error::input("reconstruction", "names no photographs", "ask again")),
    };
    let out = result_folder(data, &spec.id);
    match spec.method {
        Method::Polarization => {
            nacre_polarimetry::reconstruct(&input, &out, &spec.polarization()?, progress)?;
        }
        Method::Hdr => {
            let options = hdr::Options { overwrite: true, ..spec.options_of()? };
            hdr::reconstruct(&input, &out, &options, progress)?;
        }
        Method::Lut => {
            nacre_lut::reconstruct(&input, &out, &spec.table(&data.join("uploads"))?, progress)?;
        }
        Method::Foil => {
            let settings = foil::Settings { overwrite: true, ..spec.options_of()? };
            foil::reconstruct(&input, &out, &settings, progress)?;
        }
        Method::Calibrate => {
            let done = calibration::calibrate_folder(&input, &out, &spec.options_of()?, true, progress);
            done.map_err(|error| as_sent(error, &input))?;
        }
        Method::Map => {
            nacre_maps::edit_folder(&maps_of(spec, &input), &out, &spec.options_of()?, true, progress)?;
        }
        Method::Flash => {
            let settings = flash::Settings { overwrite: true, ..spec.options_of()? };
            flash::reconstruct(&input, &out, &settings, progress)?;
        }
        Method::Brdf => nacre_brdf::render(&input, &out, &spec.options_of()?, true, progress)?,
        Method::Spots => {
            let settings = spots::Settings { overwrite: true, ..spec.options_of()? };
            spots::reconstruct(&input, &out, &settings, progress)?;
        }
        Method::Bokeh => {
            let options = bokeh::Options { overwrite: true, ..spec.options_of()? };
            bokeh::reconstruct(&input, &out, &options, progress)?;
        }
        Method::Render => {
            let options = spec.options_of()?;
            let done = nacre_render::render_folder(&input, &out, &options, true, progress, seen);
            done.map_err(|error| as_sent(error, &input))?;
        }
    }
    Ok(())
}
