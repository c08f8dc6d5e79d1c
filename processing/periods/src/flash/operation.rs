//! The operation `flash`.

use super::input::check_input;
use super::reconstruct::fit_into;
use super::report::Report;
use super::settings::Settings;
use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, exceeds};
use nacre_base::progress::Progress;
use nacre_base::{OutputFolder, Result};
use std::path::Path;

impl Operation for Settings {
    const NAME: &'static str = "flash";
    const TITLE: &'static str =
        "Orientation and absolute period of gratings on a sheet of repeated tiles, from photographs under a flash";
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.check()
    }

    fn check(&self, input: &Path) -> Result<Work> {
        check_input(input, self)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        fit_into(out, input, self, progress)
    }

    fn missed(&self, report: &Report) -> Option<String> {
        exceeds(self.max_error, report.sigma_deg, ["σ of a typical orientation", "°", "more lights help"])
    }
}
