//! Maps as tiles of numbers at several resolutions: `/api/v1/reconstructions/{id}/tiles`.
//!
//! A tile of level L averages squares of 2^L pixels. All tiles of one row are made together, because a file stores its
//! pixels row by row; these strips are cached.

use super::heavy::Plane;
use super::map_list::{Located, MapKind, locate};
use super::problem::{Answer, Kind, Problem};
use super::{App, At, files, maps};
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use nacre_image::read_exr_rows;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Pixels along the side of a tile.
const TILE: usize = 256;

/// Maximum number of bytes of cached strips; the newest one is kept whatever its size.
const KEPT: usize = 64 << 20;

/// Time after which an unused strip is dropped.
const IDLE: Duration = Duration::from_secs(30);

/// Number of levels until the map fits into one tile.
pub fn levels(size: [usize; 2]) -> u32 {
    let tiles = size[0].max(size[1]).div_ceil(TILE).max(1);
    tiles.next_power_of_two().trailing_zeros() + 1
}

/// A tile of a map: 32-bit floats (little-endian) row by row, NaN where masked. Tiles have 256 × 256 pixels, and fewer
/// at the right and lower edge. A pixel of level L is the mean of the valid pixels among 2^L × 2^L pixels of the
/// map. Orientations are averaged as axial data, modulo 180°.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/tiles/{map}/{level}/{column}/{row}", tag = "reconstructions",
    operation_id = "map_tile",
    params(("id" = String, Path), ("map" = String, Path, description = "A name of `maps`"),
        ("level" = u32, Path, maximum = 16, description = "0 for full resolution"),
        ("column" = u32, Path, maximum = 65535, description = "Column of tiles, from the left"),
        ("row" = u32, Path, maximum = 65535, description = "Row of tiles, from the top")),
    responses((status = 200, content(([u8] = "application/octet-stream"))), (status = 404, body = Problem)))]
pub async fn tile(
    State(app): State<Arc<App>>,
    At((id, map, level, column, row)): At<(String, String, u32, u32, u32)>,
) -> Answer<Response> {
    let folder = app.place(&id).await?.results;
    let heavy = app.heavy.clone();
    let work = move || {
        let found = locate(&folder, &map)?;
        let place = place(&map, found.size, level, [column, row].map(|n| n as usize))?;
        Ok(heavy.strips.strip(&found, level, row as usize)?.cut(place))
    };
    Ok(([(header::CONTENT_TYPE, files::BYTES)], app.heavy.answer(work).await?).into_response())
}

/// Columns of a tile within its strip.
fn place(map: &str, size: [usize; 2], level: u32, [column, row]: [usize; 2]) -> Answer<Range<usize>> {
    let all = levels(size);
    if level >= all {
        let name: String = map.chars().take(80).collect();
        let remedy = format!("give a level from 0 to {}", all - 1);
        return Err(Problem::not_found(format!("level {level} of map {name:?}")).remedy(remedy));
    }
    let [width, height] = size.map(|n| n.div_ceil(1 << level));
    let [columns, rows] = [width, height].map(|n| n.div_ceil(TILE));
    if column >= columns || row >= rows {
        let remedy =
            format!("level {level} of this map has {columns} columns and {rows} rows of tiles, counted from 0");
        return Err(Problem::not_found(format!("tile in column {column}, row {row}")).remedy(remedy));
    }
    Ok(column * TILE..((column + 1) * TILE).min(width))
}

/// Rows of a map at the resolution of a level, [`TILE`] of them or fewer at its lower edge.
pub struct Strip {
    values: Vec<f32>,
    width: usize,
}

impl Strip {
    /// Values of these columns as bytes.
    fn cut(&self, columns: Range<usize>) -> Vec<u8> {
        let rows = self.values.chunks_exact(self.width);
        rows.flat_map(|row| row[columns.clone()].iter().flat_map(|v| v.to_le_bytes())).collect()
    }
}

/// A strip that is kept: its map with time and size of the file, level and row.
struct Kept {
    of: (Located, SystemTime, u64, u32, usize),
    strip: Arc<Strip>,
    used: Instant,
}

/// Cache of strips.
#[derive(Default)]
pub struct Strips {
    /// Held while a strip is made, so that neighbouring tiles that are wanted at once share it.
    making: Mutex<()>,
    kept: Mutex<VecDeque<Kept>>,
}

impl Strips {
    /// The tiles of one row of tiles.
    ///
    /// # Errors
    /// `not-found` if the map has gone; as the file is refused.
    fn strip(&self, map: &Located, level: u32, row: usize) -> Answer<Arc<Strip>> {
        let metadata = map.path.metadata().map_err(|_| maps::missing(&map.channel))?;
        let changed = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let of = (map.clone(), changed, metadata.len(), level, row);
        let _making = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        let mut kept = self.locked();
        if let Some(mut known) = kept.iter().position(|k| k.of == of).and_then(|at| kept.remove(at)) {
            known.used = Instant::now();
            let strip = known.strip.clone();
            kept.push_back(known);
            return Ok(strip);
        }
        drop(kept);
        let strip = Arc::new(made(map, level, row)?);
        let mut kept = self.locked();
        kept.push_back(Kept { of, strip: strip.clone(), used: Instant::now() });
        let bytes = |k: &Kept| k.strip.values.len() * size_of::<f32>();
        while kept.len() > 1 && kept.iter().map(bytes).sum::<usize>() > KEPT {
            kept.pop_front();
        }
        Ok(strip)
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<Kept>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Drops the strips that have not been used lately.
    pub fn forget_idle(&self) {
        self.locked().retain(|k| k.used.elapsed() < IDLE);
    }
}

/// A vector of `count` values, or a problem if the memory is short.
fn filled<T: Clone>(value: T, count: usize) -> Answer<Vec<T>> {
    let mut values = vec![];
    let short = |_| Problem::new(Kind::Unavailable, "the memory of the service does not suffice for this tile");
    values.try_reserve_exact(count).map_err(short)?;
    values.resize(count, value);
    Ok(values)
}

/// Reads the rows of a strip, and averages them.
fn made(map: &Located, level: u32, row: usize) -> Answer<Strip> {
    let first = (row * TILE) << level;
    let rows = first..(first + (TILE << level)).min(map.size[1]);
    let [width, height] = [map.size[0].div_ceil(1 << level), rows.len().div_ceil(1 << level)];
    let mut values = filled(f32::NAN, width * height)?;
    let wanted = |y: usize| rows.contains(&y);
    if level == 0 {
        read_exr_rows(&map.path, &map.channel, &wanted, |y, x, piece| {
            values[(y - first) * width + x..][..piece.len()].copy_from_slice(piece);
        })?;
        return Ok(Strip { values, width });
    }
    let mut means = Means { sums: filled([0.0; 2], width * height)?, counts: filled(0, width * height)? };
    let is_direction = map.kind == MapKind::Direction;
    read_exr_rows(&map.path, &map.channel, &wanted, |y, x, piece| {
        let start = ((y - first) >> level) * width;
        for (x, value) in (x..).zip(piece).filter(|(_, v)| v.is_finite()) {
            means.add(start + (x >> level), *value, is_direction);
        }
    })?;
    for (value, (sums, count)) in values.iter_mut().zip(means.sums.iter().zip(&means.counts)) {
        *value = mean(*sums, *count, is_direction);
    }
    Ok(Strip { values, width })
}

/// Every n-th row and column of a map, at most `width` of them per row. Memory holds these alone.
///
/// # Errors
/// As the file is refused.
pub fn thinned(map: &Located, width: usize) -> Answer<Plane> {
    let step = map.size[0].div_ceil(width.max(1)).max(1);
    let [width, height] = map.size.map(|n| n.div_ceil(step));
    let mut values = filled(f32::NAN, width * height)?;
    read_exr_rows(&map.path, &map.channel, &|y| y % step == 0, |y, x, piece| {
        for (x, value) in (x..).zip(piece).filter(|(x, _)| x % step == 0) {
            values[y / step * width + x / step] = *value;
        }
    })?;
    Ok(Plane { values, width })
}

/// Sums of values, or of the cosines and sines of twice the angles.
struct Means {
    sums: Vec<[f32; 2]>,
    counts: Vec<u32>,
}

impl Means {
    fn add(&mut self, at: usize, value: f32, is_direction: bool) {
        let [a, b] = &mut self.sums[at];
        self.counts[at] += 1;
        if is_direction {
            let (sin, cos) = (2.0 * value).sin_cos();
            *a += cos;
            *b += sin;
        } else {
            *a += value;
        }
    }
}

fn mean([a, b]: [f32; 2], count: u32, is_direction: bool) -> f32 {
    match (count, is_direction) {
        (0, _) => f32::NAN,
        (_, true) => (0.5 * b.atan2(a)).rem_euclid(std::f32::consts::PI),
        _ => a / count as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_image::write_exr;
    use std::f32::consts::PI;
    use std::path::Path;

    fn write(folder: &Path, width: usize, height: usize, value: &(dyn Fn(usize, usize) -> f32 + Sync)) -> Located {
        let fill = |_: usize, y: usize, row: &mut [f32]| row.iter_mut().enumerate().for_each(|(x, v)| *v = value(x, y));
        for (file, channel) in [("period.exr", "period"), ("orientation.exr", "orientation")] {
            write_exr(&folder.join(file), width, height, &[channel], &[], &fill).unwrap();
        }
        locate(folder, "period").unwrap()
    }

    #[test]
    fn tiles_are_parts_and_means_of_the_map() {
        let folder = tempfile::tempdir().unwrap();
        let map = write(folder.path(), 300, 530, &|x, y| if x == 7 { f32::NAN } else { (y * 300 + x) as f32 });
        assert_eq!([[1, 1], [256, 9], [257, 9], [10_000, 10_000]].map(levels), [1, 1, 2, 7]);
        let strips = Strips::default();
        let last = strips.strip(&map, 0, 2).unwrap();
        assert_eq!((last.width, last.values.len(), last.values[0]), (300, 300 * 18, 512.0 * 300.0));
        assert_eq!(place("period", map.size, 0, [1, 2]).unwrap(), 256..300);
        assert_eq!(last.cut(256..300)[..4], (512.0_f32 * 300.0 + 256.0).to_le_bytes());
        // Two rows and two columns each; of columns 6 and 7 only the first is valid.
        let half = strips.strip(&map, 1, 0).unwrap();
        assert_eq!((half.width, half.values.len()), (150, 150 * 256));
        assert_eq!(half.values[0], 150.5);
        assert_eq!(half.values[3], 156.0);
        for (level, tile) in [(3, [0, 0]), (1, [1, 0]), (0, [0, 3]), (0, [2, 0])] {
            assert!(place("period", map.size, level, tile).is_err(), "{level} {tile:?}");
        }
    }

    #[test]
    fn thinned_maps_have_every_nth_pixel() {
        let folder = tempfile::tempdir().unwrap();
        let map = write(folder.path(), 300, 50, &|x, y| (y * 300 + x) as f32);
        let thin = thinned(&map, 100).unwrap();
        assert_eq!((thin.width, thin.height(), thin.values[101]), (100, 17, 3.0 * 300.0 + 3.0));
        assert_eq!(thinned(&map, 1000).unwrap().values.len(), 300 * 50);
    }

    #[test]
    fn means_of_directions_do_not_depend_on_where_they_begin() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), 400, 300, &|x, y| if (x + y) % 2 == 0 { 0.1 } else { PI - 0.1 });
        let map = locate(folder.path(), "orientation").unwrap();
        let mean = made(&map, 1, 0).unwrap().values[5];
        assert!(mean.min(PI - mean) < 1e-4, "{mean}");
    }

    #[test]
    fn strips_are_kept_until_the_file_changes() {
        let folder = tempfile::tempdir().unwrap();
        let map = write(folder.path(), 300, 300, &|_, _| 1.0);
        let strips = Strips::default();
        let first = strips.strip(&map, 1, 0).unwrap();
        assert!(Arc::ptr_eq(&first, &strips.strip(&map, 1, 0).unwrap()));
        assert!(!Arc::ptr_eq(&first, &strips.strip(&map, 0, 0).unwrap()));
        let map = write(folder.path(), 300, 301, &|_, _| 2.0);
        assert_eq!(strips.strip(&map, 1, 0).unwrap().values[0], 2.0);
    }
}
