//! Folders of charts: a subfolder per study with raw measurements, tables and pictures, and one page with all pictures.

use super::page::{Entry, html};
use super::plan::Plan;
use super::runner::measure;
use super::summary::{Summary, summarize};
use super::{ChartFormat, Study, Width, overview, picture, png_from_svg, tables};
use nacre_base::input::{self, Unreadable};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::{rewrite, write_whole};
use nacre_plot::pdf_from_svg;
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// A picture that does not come from a study: computed, or measured as a whole.
pub struct Picture {
    /// Name of its files, and its name on the command line.
    pub name: &'static str,
    /// Group of pictures that are requested together.
    pub group: &'static str,
    /// Title.
    pub title: &'static str,
    /// Description of the picture's content.
    pub text: &'static str,
    /// Draws the picture.
    pub draw: fn() -> Result<Drawn>,
}

/// A drawn picture.
pub struct Drawn {
    /// The picture as SVG.
    pub svg: String,
    /// Machine and conditions of the measurement; empty for computed pictures.
    pub measured: String,
    /// The measured values as JSON.
    pub numbers: Option<String>,
}

impl From<String> for Drawn {
    /// A computed picture in SVG.
    fn from(svg: String) -> Self {
        Self { svg, measured: String::new(), numbers: None }
    }
}

/// Studies and pictures to chart, and the output folder.
pub struct Request<'a> {
    /// The output folder; charts of other studies in it are kept.
    pub out: &'a Path,
    /// Repeat existing measurements.
    pub force: bool,
    /// Seed, runs, effort, program version.
    pub plan: Plan,
    /// Style of the charts.
    pub format: ChartFormat,
    /// Studies to measure.
    pub studies: &'a [Study],
    /// Pictures to draw.
    pub pictures: &'a [Picture],
}

/// Content of a folder of charts: the file `charts.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Charted {
    /// Charts in the order of the page.
    pub charts: Vec<Chart>,
}

/// One chart of a folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// Name.
    pub name: String,
    /// Group.
    pub group: String,
    /// Title.
    pub title: String,
    /// Question of the study, or description of the picture.
    pub text: String,
    /// Whether the effort was [`crate::Effort::Quick`].
    pub quick: bool,
    /// Machine, program, seed and runs; empty for computed pictures.
    pub measured: String,
    /// Files, relative to the folder.
    pub files: Vec<String>,
}

/// Measures the requested studies and draws their charts. An interrupted call can be repeated and continues from the
/// stored measurements. Files are written atomically.
///
/// # Errors
/// `Error::Input` if the folder holds other files, or measurements under another seed or program without `force`.
/// `Error::Output` if the system refuses access. Any error of a study. `Error::Cancelled`.
pub fn chart(request: &Request, progress: &dyn Progress) -> Result<Charted> {
    let out = request.out;
    prepare(out)?;
    let mut charted = catalogue(out)?;
    let mut summaries = vec![];
    for study in request.studies {
        let folder = out.join(study.name);
        make_dir(&folder)?;
        let raw = folder.join("raw.jsonl");
        if request.force && raw.exists() {
            fs::remove_file(&raw).map_err(|e| Error::output(&raw, e))?;
        }
        let records = measure(study, &request.plan, &raw, progress)?;
        let summary = summarize(study, &request.plan, &records);
        charted.put(write_study(out, &summary, request.format)?);
        summaries.push(summary);
    }
    for group in groups(&summaries) {
        charted.put(write_overview(out, group, &summaries)?);
    }
    for p in request.pictures {
        progress.check()?;
        make_dir(&out.join(p.name))?;
        let drawn = (p.draw)()?;
        let mut files = write_pictures(out, p.name, &drawn.svg, Width::Page)?;
        if let Some(numbers) = &drawn.numbers {
            let file = format!("{0}/{0}.json", p.name);
            write_whole(&out.join(&file), numbers.as_bytes())?;
            files.push(file);
        }
        let text = p.text.to_owned();
        charted.put(Chart {
            name: p.name.into(),
            group: p.group.into(),
            title: p.title.into(),
            text,
            quick: false,
            measured: drawn.measured,
            files,
        });
    }
    let json = serde_json::to_vec_pretty(&charted).map_err(std::io::Error::from);
    let (json, path) = (json.map_err(|e| Error::output(out, e))?, out.join("charts.json"));
    rewrite(&path, |file| fs::write(file, json).map_err(|e| Error::output(&path, e)))?;
    let entries: Vec<Entry> = charted.charts.iter().map(Entry::from).collect();
    write_whole(&out.join("index.html"), html(&entries).as_bytes())?;
    Ok(charted)
}

/// Maximum size of `charts.json` in bytes.
const MAX_CATALOGUE: u64 = 64 << 20;

/// Reads the catalogue of a folder of charts; returns an empty catalogue if there is no `charts.json`.
///
/// # Errors
/// If the file cannot be read or has another format.
pub fn catalogue(folder: &Path) -> Result<Charted> {
    let path = folder.join("charts.json");
    match input::read(&path, MAX_CATALOGUE) {
        Ok(bytes) => serde_json::from_slice(&bytes)
            .map_err(|e| Error::file(&path, format!("is no list of charts ({e})"), "choose another --out")),
        Err(Unreadable::System(e)) if e.kind() == std::io::ErrorKind::NotFound => Ok(Charted::default()),
        Err(e) => Err(Error::file(&path, e, "check its permissions, or choose another --out")),
    }
}

/// Creates the folder, or checks the mark of an existing one. The mark is written first, so that an interrupted chart
/// can be continued.
fn prepare(out: &Path) -> Result<()> {
    const MARK: &str = ".nacre-charts";
    let refused = |e| Error::output(out, e);
    fs::create_dir_all(out).map_err(refused)?;
    let empty = fs::read_dir(out).map_err(refused)?.next().is_none();
    if !empty && !out.join(MARK).exists() {
        return Err(Error::file(out, "exists and holds something else than charts", "choose another --out"));
    }
    write_whole(&out.join(MARK), b"Charts, and the measurements behind them, made by `nacre chart`.\n")
}

fn make_dir(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::output(folder, e))
}

fn write_study(out: &Path, summary: &Summary, format: ChartFormat) -> Result<Chart> {
    let name = &summary.name;
    write_whole(&out.join(format!("{name}/{name}.csv")), tables::csv(summary).as_bytes())?;
    let json = serde_json::to_vec_pretty(summary).map_err(std::io::Error::from);
    write_whole(&out.join(format!("{name}/{name}.json")), &json.map_err(|e| Error::output(out, e))?)?;
    let mut files = write_pictures(out, name, &picture::draw(summary, format), format.width)?;
    files.extend(["csv", "json"].map(|kind| format!("{name}/{name}.{kind}")));
    files.push(format!("{name}/raw.jsonl"));
    Ok(Chart {
        name: name.clone(),
        group: summary.group.clone(),
        title: summary.title.clone(),
        text: summary.question.clone(),
        quick: summary.plan.effort == super::Effort::Quick,
        measured: measured(summary),
        files,
    })
}

fn measured(summary: &Summary) -> String {
    let (machine, plan) = (&summary.machine, &summary.plan);
    format!(
        "Measured on {} ({} threads, {}) with version {}, seed {}, {} runs per setting{}.",
        machine.cpu,
        machine.cores,
        machine.system,
        plan.version,
        plan.seed,
        plan.runs,
        plan.effort.pick("", "; a quick look on small scenes, not for conclusions")
    )
}

/// Groups with enough studies for an overview picture.
fn groups(summaries: &[Summary]) -> Vec<&str> {
    let mut found: Vec<&str> = vec![];
    for s in summaries {
        let members = summaries.iter().filter(|o| o.group == s.group && s.group.ends_with("stress")).count();
        if members > 1 && !found.contains(&s.group.as_str()) {
            found.push(&s.group);
        }
    }
    found
}

fn write_overview(out: &Path, group: &str, summaries: &[Summary]) -> Result<Chart> {
    let members: Vec<&Summary> = summaries.iter().filter(|s| s.group == group).collect();
    let name = format!("{group}-overview");
    make_dir(&out.join(&name))?;
    let title = "Where it breaks: error against everything that makes the task hard";
    let files = write_pictures(out, &name, &overview::draw(title, &members), Width::Page)?;
    let text = "One panel per difficulty; the charts below show each at full size.".to_owned();
    let quick = members.iter().any(|s| s.plan.effort == super::Effort::Quick);
    let measured = members.first().map_or(String::new(), |s| measured(s));
    Ok(Chart { name, group: group.into(), title: title.into(), text, quick, measured, files })
}

fn write_pictures(out: &Path, name: &str, svg: &str, width: Width) -> Result<Vec<String>> {
    let files = ["svg", "png", "pdf"].map(|kind| format!("{name}/{name}.{kind}"));
    write_whole(&out.join(&files[0]), svg.as_bytes())?;
    write_whole(&out.join(&files[1]), &png_from_svg(svg, width.zoom())?)?;
    write_whole(&out.join(&files[2]), &pdf_from_svg(svg)?)?;
    Ok(files.into())
}

impl Charted {
    /// Adds a chart, or replaces the chart of the same name at its position.
    fn put(&mut self, chart: Chart) {
        match self.charts.iter_mut().find(|c| c.name == chart.name) {
            Some(old) => *old = chart,
            None => self.charts.push(chart),
        }
    }
}

impl From<&Chart> for Entry {
    fn from(chart: &Chart) -> Self {
        let (name, title, text) = (chart.name.clone(), chart.title.clone(), chart.text.clone());
        Self { name, title, text, measured: chart.measured.clone(), files: chart.files.clone() }
    }
}
