//! Time of `nacre reconstruct` relative to decoding its photographs and writing its results, and time of the fit
//! relative to a copy.
//!
//! `cargo run --release -p nacre-processing --example speed -- SESSION SCRATCH` measures the command, including memory,
//! on photographs that are generated if missing. Without arguments it measures the fit.
//!
//! All candidates run in turn, and the minimum of each is printed, so that other programs on the machine affect all
//! alike. CPU seconds (Linux only) exclude waiting for other processes and for the disk.

#![allow(clippy::print_stdout)]

mod scene;

use nacre_processing::frames::load;
use nacre_processing::image::read;
use nacre_processing::polarimetry::{Design, Model, Options, Smoothing, StokesMaps, fit_stack, reconstruct};
use nacre_processing::progress::Silent;
use rayon::prelude::*;
use std::error::Error;
use std::fs;
use std::path::Path;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

const ROUNDS: usize = 5;
const PIXELS: usize = 4096 * 3072;
const FRAMES: usize = 13;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    match (arguments.next(), arguments.next()) {
        (Some(session), Some(scratch)) => whole(Path::new(&session), Path::new(&scratch)),
        _ => kernel(),
    }
}

/// One thread, 13 frames of 12.6 Mpixel in memory.
fn kernel() -> Outcome<()> {
    let value = |k: usize, i: usize| 1000.0 + ((7 * i + 13 * k) % 251) as f32;
    let frames: Vec<Vec<f32>> = (0..FRAMES).map(|k| (0..PIXELS).map(|i| value(k, i)).collect()).collect();
    let slices: Vec<&[f32]> = frames.iter().map(Vec::as_slice).collect();
    let angles: Vec<f64> = (0..FRAMES).map(|k| std::f64::consts::PI * k as f64 / FRAMES as f64).collect();
    let design = Design::new(&angles)?;
    let (mut target, mut maps) = (frames.clone(), StokesMaps::default());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut times = [const { vec![] }; 3];
    for _ in 0..4 * ROUNDS {
        pool.install(|| -> Outcome<()> {
            times[0].push(thread_seconds(|| target.iter_mut().zip(&frames).for_each(|(t, s)| t.copy_from_slice(s)))?);
            times[1].push(thread_seconds(|| fit_stack(&slices, 4096, &design, &mut maps))?);
            times[2].push(thread_seconds(|| {
                let mut fresh = StokesMaps::default();
                fit_stack(&slices, 4096, &design, &mut fresh);
            })?);
            Ok(())
        })?;
    }
    let names = ["copy of 13 frames", "fit of 13 frames", "the same, maps made anew"];
    println!("one thread, CPU seconds      least  median  GB/s at least");
    for ((name, mut times), bytes) in names.into_iter().zip(times).zip([8 * FRAMES, 4 * FRAMES + 20, 4 * FRAMES + 20]) {
        times.sort_by(f64::total_cmp);
        let speed = (bytes * PIXELS) as f64 / times[0] / 1e9;
        println!("{name:28} {:.4} {:.4}  {speed:.1}", times[0], times[times.len() / 2]);
    }
    Ok(())
}

/// CPU seconds of this thread.
fn thread_seconds(job: impl FnOnce()) -> Outcome<f64> {
    let now = || -> Outcome<f64> {
        let text = fs::read_to_string("/proc/thread-self/schedstat")?;
        Ok(1e-9 * text.split_whitespace().next().unwrap_or_default().parse::<f64>()?)
    };
    let begun = now()?;
    job();
    Ok(now()? - begun)
}

fn whole(session: &Path, scratch: &Path) -> Outcome<()> {
    if !session.exists() {
        scene::make(session, [4096, PIXELS / 4096], FRAMES)?;
    }
    fs::create_dir_all(scratch)?;
    let out = scratch.join("result");
    let command = |model: Model, smooth: Smoothing| -> Outcome<()> {
        let options = Options { model: Some(model), smooth, ..Options::default() };
        let report = reconstruct(session, &out, &options, &Silent)?;
        println!("  {model:?}, smoothing {smooth}: {:?}", report.seconds);
        Ok(())
    };
    if out.exists() {
        fs::remove_dir_all(&out)?;
    }
    command(Model::Sinusoid, Smoothing::NONE)?;
    let status = fs::read_to_string("/proc/self/status")?;
    status.lines().filter(|l| l.starts_with("VmHWM")).for_each(|peak| println!("peak of its memory: {peak}"));
    let bytes = fs::read_dir(&out)?.map(|entry| Ok(fs::read(entry?.path())?)).collect::<Outcome<Vec<_>>>()?;
    let names = ["decode and write", "sinusoid", "auto", "decode only"];
    let mut times = [const { vec![] }; 4];
    let written = scratch.join("written");
    for _ in 0..ROUNDS {
        // Into new folders, so that the time to delete old files is not counted.
        let fresh = || [&out, &written].into_iter().filter(|old| old.exists()).try_for_each(fs::remove_dir_all);
        fresh()?;
        times[0].push(timed(|| decode(session).and_then(|()| write(&written, &bytes)))?);
        fresh()?;
        times[1].push(timed(|| command(Model::Sinusoid, Smoothing::NONE))?);
        fresh()?;
        times[2].push(timed(|| command(Model::Auto, Smoothing::NONE))?);
        times[3].push(timed(|| decode(session))?);
    }
    println!(
        "whole command, {} MB written          wall s (least, median)  CPU s",
        bytes.iter().map(Vec::len).sum::<usize>() >> 20
    );
    for (name, times) in names.into_iter().zip(times) {
        let sorted = |k: usize| {
            let mut of: Vec<f64> = times.iter().map(|t: &[f64; 2]| t[k]).collect();
            of.sort_by(f64::total_cmp);
            of
        };
        let (wall, cpu) = (sorted(0), sorted(1));
        println!("{name:20} {:.2} {:.2}  {:.2} {:.2}", wall[0], wall[ROUNDS / 2], cpu[0], cpu[ROUNDS / 2]);
    }
    Ok(())
}

/// Two photographs at a time, with the command's reader.
fn decode(session: &Path) -> Outcome<()> {
    let frames = load(session)?;
    let files: Vec<_> = frames.set.frames.iter().map(|f| frames.file(&f.file)).collect();
    for pair in files.chunks(2) {
        pair.par_iter().try_for_each(|file| read(file).map(|image| drop(std::hint::black_box(image))))?;
    }
    Ok(())
}

/// Plain files, synced like those of the command.
fn write(folder: &Path, files: &[Vec<u8>]) -> Outcome<()> {
    fs::create_dir_all(folder)?;
    files.par_iter().enumerate().try_for_each(|(i, bytes)| -> Outcome<()> {
        let path = folder.join(i.to_string());
        fs::write(&path, bytes)?;
        Ok(fs::File::open(&path)?.sync_all()?)
    })
}

/// Wall and CPU seconds.
fn timed(job: impl FnOnce() -> Outcome<()>) -> Outcome<[f64; 2]> {
    let cpu = || -> Outcome<f64> {
        let text = fs::read_to_string("/proc/self/stat")?;
        let fields: Vec<&str> = text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        let ticks = |k: usize| fields.get(k).copied().unwrap_or_default().parse::<f64>();
        // User and system time, in hundredths of a second on every Linux.
        Ok(0.01 * (ticks(11)? + ticks(12)?))
    };
    let (begun, before) = (Instant::now(), cpu()?);
    job()?;
    Ok([begun.elapsed().as_secs_f64(), cpu()? - before])
}
