//! Memory bound of requests for maps. Few run at once, and large answers wait until others have been sent. Recently
//! read maps are cached, as one page requests several pictures of one map.

use super::problem::{Answer, Kind, Problem};
use super::tiles::Strips;
use super::{blocking, files, maps};
use axum::body::{Body, Bytes};
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use nacre_image::read_exr_channel;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Simultaneous pieces of work. Each encodes its picture on one core.
const PLACES: u32 = 2;

/// Most bytes of cached maps; the newest one is kept whatever its size.
const KEPT: usize = 128 << 20;

/// Time after which an unused map leaves the cache.
const IDLE: Duration = Duration::from_secs(10);

/// Most MiB of answers on their way to clients. Answers below 1 MiB do not count.
const SENDING_MIB: usize = 96;

/// Longest wait of an answer for others to be sent.
const PATIENCE: Duration = Duration::from_secs(20);

/// Bytes per piece of an answer.
const PIECE: usize = 64 << 10;

/// Pixels per piece of a table.
const PIXELS: usize = 1 << 18;

/// One channel of a map.
pub struct Plane {
    /// Values, row 0 on top.
    pub values: Vec<f32>,
    /// Pixels per row.
    pub width: usize,
}

impl Plane {
    /// Number of rows.
    pub fn height(&self) -> usize {
        self.values.len() / self.width.max(1)
    }
}

/// A cached map.
struct Kept {
    path: PathBuf,
    channel: String,
    /// Modification time and size of its file.
    stamp: (SystemTime, u64),
    plane: Arc<Plane>,
    used: Instant,
}

/// Places for work that takes much memory.
pub struct Heavy {
    places: Arc<Semaphore>,
    /// Held while a map is read, so that simultaneous requests read it once.
    reading: Mutex<()>,
    sending: Arc<Semaphore>,
    kept: Mutex<VecDeque<Kept>>,
    /// Rows of tiles.
    pub strips: Strips,
}

impl Default for Heavy {
    fn default() -> Self {
        Self {
            places: Arc::new(Semaphore::new(PLACES as usize)),
            reading: Mutex::default(),
            sending: Arc::new(Semaphore::new(SENDING_MIB)),
            kept: Mutex::default(),
            strips: Strips::default(),
        }
    }
}

impl Heavy {
    /// Runs the work on a separate thread once there is a place. The work keeps its place to the end, even if the
    /// request is dropped.
    ///
    /// # Errors
    /// Those of the work.
    pub async fn work<T: Send + 'static>(&self, work: impl FnOnce() -> Answer<T> + Send + 'static) -> Answer<T> {
        Ok(self.begin(1, work).await?.0)
    }

    async fn begin<T: Send + 'static>(
        &self,
        places: u32,
        work: impl FnOnce() -> Answer<T> + Send + 'static,
    ) -> Answer<(T, OwnedSemaphorePermit)> {
        let place = self.places.clone().acquire_many_owned(places).await;
        let place = place.map_err(|_| Problem::new(Kind::Internal, "the service is stopping"))?;
        blocking(move || work().map(|done| (done, place))).await
    }

    /// Answers with the bytes that the work returns. Its place is freed once there is room for the answer.
    ///
    /// # Errors
    /// Those of the work; `too-many` when clients read other answers too slowly.
    pub async fn answer(&self, work: impl FnOnce() -> Answer<Vec<u8>> + Send + 'static) -> Answer<Response> {
        let (bytes, _place) = self.begin(1, work).await?;
        self.send(bytes).await
    }

    /// Same for work that reads whole results: it takes all places, and the cache is emptied.
    ///
    /// # Errors
    /// Those of [`Self::answer`].
    pub async fn answer_alone(
        self: &Arc<Self>,
        work: impl FnOnce() -> Answer<Vec<u8>> + Send + 'static,
    ) -> Answer<Response> {
        let heavy = self.clone();
        let alone = move || {
            heavy.locked().clear();
            work()
        };
        let (bytes, _places) = self.begin(PLACES, alone).await?;
        self.send(bytes).await
    }

    async fn send(&self, bytes: Vec<u8>) -> Answer<Response> {
        if bytes.len() < 1 << 20 {
            return Ok(bytes.into_response());
        }
        let cost = (bytes.len() >> 20).min(SENDING_MIB) as u32;
        let place = tokio::time::timeout(PATIENCE, self.sending.clone().acquire_many_owned(cost)).await;
        let Ok(Ok(place)) = place else {
            return Err(Problem::new(Kind::TooMany, "other large answers are still being read").remedy("try again"));
        };
        let length = HeaderValue::from(bytes.len());
        let pieces = futures::stream::unfold((Bytes::from(bytes), place), |(mut rest, place)| async move {
            let piece = rest.split_to(rest.len().min(PIECE));
            (!piece.is_empty()).then_some((Ok::<_, std::io::Error>(piece), (rest, place)))
        });
        Ok(([(header::CONTENT_LENGTH, length)], Body::from_stream(pieces)).into_response())
    }

    /// A channel of a map in a result folder, by the map's name. Call it from heavy work only.
    ///
    /// # Errors
    /// `not-found` when there is no such map.
    pub fn plane(&self, folder: &Path, name: &str) -> Answer<Arc<Plane>> {
        let missing = || maps::missing(name);
        let (file, channel) = maps::source(folder, name).ok_or_else(missing)?;
        let path = files::inside(folder, &file).map_err(|_| missing())?;
        let metadata = path.metadata().map_err(|_| missing())?;
        let stamp = (metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH), metadata.len());
        let _reading = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
        let mut kept = self.locked();
        let same = |k: &Kept| k.path == path && k.channel == channel && k.stamp == stamp;
        if let Some(mut known) = kept.iter().position(same).and_then(|at| kept.remove(at)) {
            known.used = Instant::now();
            let plane = known.plane.clone();
            kept.push_back(known);
            return Ok(plane);
        }
        drop(kept);
        let (values, width) = read_exr_channel(&path, &channel)?.ok_or_else(missing)?;
        let plane = Arc::new(Plane { values, width });
        let mut kept = self.locked();
        kept.push_back(Kept { path, channel, stamp, plane: plane.clone(), used: Instant::now() });
        let bytes = |k: &Kept| k.plane.values.len() * size_of::<f32>();
        while kept.len() > 1 && kept.iter().map(bytes).sum::<usize>() > KEPT {
            kept.pop_front();
        }
        Ok(plane)
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<Kept>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Removes unused maps from the cache after [`IDLE`].
    pub fn forget_idle(&self) {
        self.locked().retain(|k| k.used.elapsed() < IDLE);
        self.strips.forget_idle();
    }

    /// A map as a table or array, made in pieces while it is sent: `head`, then the rows as `rows` writes them. No
    /// place and no memory is held between pieces.
    ///
    /// # Errors
    /// `not-found` when there is no such map.
    pub async fn table(
        self: &Arc<Self>,
        folder: PathBuf,
        name: String,
        head: impl FnOnce(&Plane) -> Vec<u8> + Send + 'static,
        rows: fn(&Plane, std::ops::Range<usize>) -> Vec<u8>,
    ) -> Answer<Body> {
        let (heavy, of) = (self.clone(), (folder.clone(), name.clone()));
        let begun = move || {
            let plane = heavy.plane(&of.0, &of.1)?;
            Ok((head(&plane), [plane.width, plane.height()]))
        };
        let (head, size) = self.work(begun).await?;
        let of = Arc::new((folder, name));
        let state = (self.clone(), of, 0, Some(head));
        let pieces = futures::stream::try_unfold(state, move |(heavy, of, row, head)| async move {
            if let Some(head) = head {
                return Ok(Some((Bytes::from(head), (heavy, of, row, None))));
            }
            let next = (row + (PIXELS / size[0].max(1)).max(1)).min(size[1]);
            if row >= next {
                return Ok(None);
            }
            let (reader, named) = (heavy.clone(), of.clone());
            let piece = heavy.work(move || {
                let plane = reader.plane(&named.0, &named.1)?;
                let same = [plane.width, plane.height()] == size;
                if same { Ok(rows(&plane, row..next)) } else { Err(maps::missing(&named.1)) }
            });
            // If the map was replaced meanwhile, the answer ends early, which clients notice.
            let piece = piece.await.map_err(|problem| std::io::Error::other(problem.to_string()))?;
            Ok::<_, std::io::Error>(Some((Bytes::from(piece), (heavy, of, next, None))))
        });
        Ok(Body::from_stream(pieces))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_image::write_exr;

    fn map(folder: &Path, sigma: f32, width: usize) {
        let fill = |_: usize, _: usize, row: &mut [f32]| row.fill(sigma);
        write_exr(&folder.join("aolp.exr"), width, 4, &["aolp", "sigma"], &[], &fill).unwrap();
    }

    #[test]
    fn maps_are_kept_until_they_change_or_are_idle() {
        let folder = tempfile::tempdir().unwrap();
        map(folder.path(), 1.0, 3);
        let heavy = Heavy::default();
        let plane = |name: &str| heavy.plane(folder.path(), name).unwrap();
        let first = plane("sigma");
        assert_eq!((first.width, first.height()), (3, 4));
        assert!(Arc::ptr_eq(&first, &plane("sigma")) && !Arc::ptr_eq(&first, &plane("aolp")));
        map(folder.path(), 2.0, 5);
        assert_eq!((plane("sigma").width, plane("sigma").values[0]), (5, 2.0));
        heavy.forget_idle();
        assert_eq!(heavy.locked().len(), 3);
        assert!(heavy.plane(folder.path(), "period").is_err() && heavy.plane(folder.path(), "x").is_err());
    }

    #[tokio::test]
    async fn heavy_work_has_few_places_even_if_nobody_waits() {
        let heavy = Arc::new(Heavy::default());
        let running = Arc::new(Mutex::new(0));
        let work = |most: u32| {
            let running = running.clone();
            move || {
                let now = {
                    let mut running = running.lock().unwrap();
                    *running += 1;
                    *running
                };
                assert!(now <= most, "{now} at once");
                std::thread::sleep(Duration::from_millis(20));
                *running.lock().unwrap() -= 1;
                Ok(vec![])
            }
        };
        // This work is abandoned while it runs.
        let _ = tokio::time::timeout(Duration::from_millis(5), heavy.work(work(PLACES))).await;
        let all = (0..6).map(|_| heavy.work(work(PLACES)));
        let alone = (0..3).map(|_| heavy.answer_alone(work(1)));
        let (all, alone) = futures::join!(futures::future::join_all(all), futures::future::join_all(alone));
        assert!(all.iter().all(Result::is_ok) && alone.iter().all(Result::is_ok));
    }

    #[tokio::test]
    async fn large_answers_wait_for_each_other() {
        let heavy = Heavy::default();
        let large = || heavy.answer(|| Ok(vec![7; SENDING_MIB << 20]));
        let first = large().await.unwrap();
        assert_eq!(first.headers()["content-length"], (SENDING_MIB << 20).to_string().as_str());
        let second = large();
        tokio::pin!(second);
        assert!(tokio::time::timeout(Duration::from_millis(50), second.as_mut()).await.is_err());
        let body = axum::body::to_bytes(first.into_body(), usize::MAX).await.unwrap();
        assert!(body.len() == SENDING_MIB << 20 && body.iter().all(|byte| *byte == 7));
        assert!(second.await.is_ok());
    }
}
