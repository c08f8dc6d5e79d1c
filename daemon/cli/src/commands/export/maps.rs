//! Maps in formats of other programs.

use super::{Exported, Format, written};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::{Attribute, ExrHeader, OutputFolder, csv_head, csv_rows, npy_head, npy_rows};
use nacre_image::{read_exr, read_exr_channel, read_exr_header, write_exr_zip, write_tiff};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes the channels of all maps of `input`, a folder or a file.
pub fn write(
    input: &Path,
    format: Format,
    channels: &[String],
    folder: &OutputFolder,
    progress: &dyn Progress,
) -> Result<Exported> {
    let maps = maps(input)?;
    let headers = maps.iter().map(|path| read_exr_header(path)).collect::<Result<Vec<_>>>()?;
    let wanted = |name: &String| channels.is_empty() || channels.contains(name);
    check_channels(channels, &headers)?;
    let selected = headers.iter().map(|h| h.channels.iter().filter(|c| wanted(c)).count()).sum::<usize>();
    progress.stage("exporting maps", selected as u64);
    let mut exported = Exported::default();
    for (path, header) in maps.iter().zip(&headers) {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let selected: Vec<&String> = header.channels.iter().filter(|c| wanted(c)).collect();
        if format == Format::Exr {
            if selected.is_empty() {
                continue;
            }
            let name = format!("{stem}.exr");
            compress(path, header, &selected, &folder.path(&name))?;
            selected.iter().for_each(|_| progress.step());
            written(&mut exported, folder, name)?;
            continue;
        }
        for channel in selected {
            progress.check()?;
            let extension = match format {
                Format::Npy => "npy",
                Format::Csv => "csv",
                _ => "tif",
            };
            // Names of channels may contain points and slashes.
            let name = format!("{stem}.{}.{extension}", channel.replace(['/', '\\'], "_"));
            write_channel(path, channel, header, format, &folder.path(&name))?;
            progress.step();
            written(&mut exported, folder, name)?;
        }
    }
    Ok(exported)
}

/// Checks that each wanted channel is in some map.
pub(super) fn check_channels(wanted: &[String], headers: &[ExrHeader]) -> Result<()> {
    let Some(missing) = wanted.iter().find(|c| !headers.iter().any(|h| h.channels.contains(c))) else { return Ok(()) };
    let mut known: Vec<&str> = headers.iter().flat_map(|h| h.channels.iter().map(String::as_str)).collect();
    known.sort_unstable();
    known.dedup();
    let remedy = format!("give some of {}", known.join(", "));
    Err(Error::input("--channel", format!("{missing} is in no map"), remedy))
}

/// The EXR files of a folder, or the single file.
fn maps(input: &Path) -> Result<Vec<PathBuf>> {
    let maps = listed(input)?;
    if maps.is_empty() {
        return Err(Error::file(input, "contains no map (EXR)", "give a folder with results, or --format bag"));
    }
    Ok(maps)
}

/// As [`maps`], without an error for a folder without maps.
pub(super) fn listed(input: &Path) -> Result<Vec<PathBuf>> {
    if !input.is_dir() {
        return Ok(vec![input.to_path_buf()]);
    }
    let unreadable = |e| Error::file(input, format!("cannot be read: {e}"), "check the folder");
    let entries = std::fs::read_dir(input).map_err(unreadable)?;
    let mut maps: Vec<PathBuf> =
        entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.extension().is_some_and(|e| e == "exr")).collect();
    maps.sort();
    Ok(maps)
}

/// Unit of a channel, from the attribute `units`: `orientation, sigma: rad; mask: …`.
pub(super) fn unit<'a>(header: &'a ExrHeader, channel: &str) -> &'a str {
    let Some(units) = header.attributes.get("units") else { return "" };
    let mut parts = units.split(';').filter_map(|part| part.split_once(':'));
    parts.find(|(names, _)| names.split(',').any(|n| n.trim() == channel)).map_or("", |(_, unit)| unit.trim())
}

fn write_channel(path: &Path, channel: &str, header: &ExrHeader, format: Format, out: &Path) -> Result<()> {
    let missing = || Error::file(path, format!("has no channel {channel}"), "it was changed meanwhile; try again");
    let (values, width) = read_exr_channel(path, channel)?.ok_or_else(missing)?;
    let unit = unit(header, channel);
    if format == Format::Tiff {
        let pitch_um = header.attributes.get("pixel_um").and_then(|text| text.parse().ok());
        let unit = if unit.is_empty() { String::new() } else { format!(", {unit}") };
        return write_tiff(out, &values, width, pitch_um, &format!("{channel}{unit}"));
    }
    let write = || {
        let mut file = BufWriter::new(File::create(out)?);
        if format == Format::Npy {
            file.write_all(&npy_head([width, values.len() / width.max(1)]))?;
        } else {
            file.write_all(&csv_head(channel, unit))?;
        }
        for (row, values) in values.chunks_exact(width.max(1)).enumerate() {
            file.write_all(&if format == Format::Npy { npy_rows(values) } else { csv_rows(values, width, row) })?;
        }
        file.flush()
    };
    write().map_err(|e| Error::output(out, e))
}

/// Writes the selected channels of a map with ZIP compression, and all its attributes.
fn compress(path: &Path, header: &ExrHeader, channels: &[&String], out: &Path) -> Result<()> {
    let map = read_exr(path)?;
    let is_number = |name: &str| name.ends_with("_um") || name.ends_with("_nm");
    let value = |(name, text): (&String, &String)| match text.parse() {
        Ok(number) if is_number(name) => Attribute::Number(number),
        _ => Attribute::Text(text.clone()),
    };
    let attributes: Vec<(&str, Attribute)> = map.attributes.iter().map(|pair| (pair.0.as_str(), value(pair))).collect();
    let planes: Vec<&[f32]> = channels.iter().map(|c| map.channels[*c].as_slice()).collect();
    let names: Vec<&str> = channels.iter().map(|c| c.as_str()).collect();
    let width = header.width;
    write_exr_zip(out, [width, header.height], &names, &attributes, &|c, y, row| {
        row.copy_from_slice(&planes[c][y * width..(y + 1) * width]);
    })
}
