//! Connections of clients. Each must make progress, and idle ones are closed for new ones, so that STOP is always
//! served.

use super::config::LimitsSection;
use super::problem::{Kind, Problem};
use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use axum::http::header;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::serve::Listener;
use futures::StreamExt;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::io::{self, IoSlice};
use std::net::SocketAddr;
use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::{Notify, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep, sleep_until, timeout_at};

/// Bytes that count as progress. A byte every few seconds does not.
const PROGRESS: usize = 16 << 10;

/// Time between the answer to an overdue request and the end of its connection.
const FAREWELL: Duration = Duration::from_secs(5);

/// When all places are taken, this part (1/8) of the connections is asked to close.
const ROOM: usize = 8;

/// Time in which a connection that was asked to close reads a request that has already arrived.
const LAST_LOOK: Duration = Duration::from_millis(1);

/// Wait before more connections are asked to close.
const AGAIN: Duration = Duration::from_millis(3);

/// Time for requests in progress once the service stops.
const GRACE: Duration = Duration::from_secs(2);

/// Connections besides those of requests and event streams: STOP, uploads, downloads, idle browsers.
const SPARE: usize = 64;

/// Open files of sessions, jobs and databases, besides those of connections.
const RESERVED: usize = 256;

/// Open files per connection: its socket, and the file of an upload or download.
const FILES: usize = 2;

/// Connections that wait to be accepted.
const BACKLOG: u32 = 1024;

/// Bytes of the system's send buffer. A slow reader's progress is visible once a third of the buffer is free.
const SEND_BUFFER: u32 = 128 << 10;

/// Raises the limit of open files if necessary, and lowers requests and event streams if that is refused. Returns the
/// number of connections that fit.
pub fn fit(limits: &mut LimitsSection) -> usize {
    let wanted = limits.requests + limits.subscribers + SPARE;
    share(limits, wanted, open_files(FILES * wanted + RESERVED))
}

/// Lowers the limits of requests and event streams in proportion until all connections fit `most` open files. Returns
/// the number of connections that fit.
fn share(limits: &mut LimitsSection, wanted: usize, most: usize) -> usize {
    let fitting = (most - RESERVED.min(most / 2)) / FILES;
    if fitting >= wanted {
        return wanted;
    }
    let part = |n: usize| (n * fitting / wanted).max(1);
    (limits.requests, limits.subscribers) = (part(limits.requests), part(limits.subscribers));
    tracing::warn!(open_files = most, limits.requests, limits.subscribers, "lowered to fit the limit of open files");
    fitting
}

/// Limit of open files of this process, raised to `wanted` if the system allows it.
fn open_files(wanted: usize) -> usize {
    let wanted = wanted as u64;
    let now = getrlimit(Resource::Nofile);
    if now.current.is_some_and(|n| n < wanted) {
        let raised = now.maximum.map_or(wanted, |most| most.min(wanted));
        // If the system refuses, the old limit holds and is returned below.
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(raised), ..now });
    }
    getrlimit(Resource::Nofile).current.map_or(usize::MAX, |n| n as usize)
}

/// Listens on an address.
///
/// # Errors
/// Those of the system.
pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    socket.set_reuseaddr(true)?;
    // Accepted connections inherit it.
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// Progress of a connection.
pub struct Activity {
    patience: Duration,
    state: Mutex<Progress>,
    /// Signals that another connection needs the place.
    leave: Notify,
}

struct Progress {
    since: Instant,
    /// Bytes since the last progress.
    moved: usize,
    /// Number of pieces of work for this client; meanwhile the client need not make progress.
    at_work: usize,
}

/// Work for a client, until dropped.
pub struct Work(Arc<Activity>);

impl Drop for Work {
    fn drop(&mut self) {
        self.0.locked().at_work -= 1;
        self.0.progress();
    }
}

impl Activity {
    /// Activity of a client that must make progress within this time.
    pub fn new(patience: Duration) -> Self {
        let state = Progress { since: Instant::now(), moved: 0, at_work: 0 };
        Self { patience, state: Mutex::new(state), leave: Notify::new() }
    }

    fn locked(&self) -> MutexGuard<'_, Progress> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Restarts the client's time for the next step.
    fn progress(&self) {
        let mut state = self.locked();
        (state.since, state.moved) = (Instant::now(), 0);
    }

    fn moved(&self, bytes: usize) {
        let mut state = self.locked();
        state.moved += bytes;
        if state.moved >= PROGRESS {
            (state.since, state.moved) = (Instant::now(), 0);
        }
    }

    /// Begins work for the client.
    pub fn work(self: &Arc<Self>) -> Work {
        self.locked().at_work += 1;
        Work(self.clone())
    }

    /// Time since which the service has waited for the client; `None` while it works for the client.
    fn waiting(&self) -> Option<Instant> {
        let state = self.locked();
        (state.at_work == 0).then_some(state.since)
    }

    /// Returns once the connection was asked to close and no request had arrived.
    async fn dismissed(&self) {
        loop {
            self.leave.notified().await;
            let since = self.waiting();
            // tokio reports all arrived data before a timer.
            sleep(LAST_LOOK).await;
            if since.is_some() && self.waiting() == since {
                return;
            }
        }
    }

    /// Returns once the client has made no progress for its time limit and `longer`.
    async fn overdue(&self, longer: Duration) {
        let patience = self.patience + longer;
        loop {
            let since = self.waiting().unwrap_or_else(Instant::now);
            sleep_until(since + patience).await;
            if self.waiting().is_some_and(|since| since.elapsed() >= patience) {
                return;
            }
        }
    }
}

/// Refuses requests that arrive too slowly; keeps the connections of event streams.
pub async fn in_pace(request: Request, next: Next) -> Response {
    let Some(activity) = request.extensions().get::<Arc<Activity>>().cloned() else {
        return next.run(request).await;
    };
    activity.progress();
    let response = tokio::select! {
        biased;
        response = next.run(request) => response,
        () = activity.overdue(Duration::ZERO) => {
            let seconds = activity.patience.as_secs_f64();
            Problem::new(Kind::Slow, format!("less than {} KiB of the request came in {seconds} s", PROGRESS >> 10))
                .remedy("send it faster, or raise limits.client_s in the configuration of the service")
                .into_response()
        }
    };
    activity.progress();
    if response.headers().get(header::CONTENT_TYPE).is_none_or(|kind| kind != "text/event-stream") {
        return response;
    }
    let work = activity.work();
    response.map(|body| {
        Body::from_stream(body.into_data_stream().inspect(move |_| {
            let _until_the_end = &work;
        }))
    })
}

struct Connection {
    activity: Arc<Activity>,
    task: JoinHandle<()>,
}

/// Serves at most `most` connections until `stop`, then waits [`GRACE`] for requests in progress.
pub async fn serve(
    mut listener: TcpListener,
    router: Router,
    most: usize,
    patience: Duration,
    stop: impl Future<Output = ()>,
) {
    let (closing, closed) = watch::channel(false);
    let mut open: Vec<Connection> = vec![];
    let mut stop = pin!(stop);
    loop {
        let accept = async {
            let (stream, _) = Listener::accept(&mut listener).await;
            make_room(&mut open, most).await;
            stream
        };
        let stream = tokio::select! {
            biased;
            () = &mut stop => break,
            stream = accept => stream,
        };
        let activity = Arc::new(Activity::new(patience));
        let task = tokio::spawn(drive(stream, router.clone(), activity.clone(), closed.clone()));
        open.push(Connection { activity, task });
    }
    drop(listener);
    closing.send_replace(true);
    let end = Instant::now() + GRACE;
    for Connection { mut task, .. } in open {
        if timeout_at(end, &mut task).await.is_err() {
            task.abort();
            let _ = task.await;
        }
    }
}

/// Waits for a place for one more connection; if there is none, connections with the longest idle time are closed.
async fn make_room(open: &mut Vec<Connection>, most: usize) {
    loop {
        open.retain(|c| !c.task.is_finished());
        if open.len() < most {
            return;
        }
        let mut waiting: Vec<_> = open.iter().filter_map(|c| Some((c.activity.waiting()?, &c.activity))).collect();
        waiting.sort_by_key(|(since, _)| *since);
        waiting.iter().take((most / ROOM).max(1)).for_each(|(_, activity)| activity.leave.notify_waiters());
        sleep(AGAIN).await;
    }
}

/// Serves one connection until it ends, is overdue, must make room, or the service stops.
///
/// hyper's own deadline of headers is not used: it also runs while a client reads the answer before.
async fn drive(stream: TcpStream, router: Router, activity: Arc<Activity>, mut closing: watch::Receiver<bool>) {
    let router = TowerToHyperService::new(router);
    let of = activity.clone();
    let service = service_fn(move |mut request: hyper::Request<Incoming>| {
        request.extensions_mut().insert(of.clone());
        router.call(request)
    });
    let io = TokioIo::new(Watched { stream, activity: activity.clone() });
    let mut connection = pin!(http1::Builder::new().serve_connection(io, service));
    let mut told = false;
    loop {
        tokio::select! {
            biased;
            ended = connection.as_mut() => {
                if let Err(error) = ended {
                    tracing::debug!("a connection ended: {error}");
                }
                return;
            }
            _ = closing.wait_for(|closing| *closing), if !told => {
                told = true;
                connection.as_mut().graceful_shutdown();
            }
            () = activity.overdue(FAREWELL) => return,
            () = activity.dismissed() => return,
        }
    }
}

/// A stream that records its progress.
struct Watched {
    stream: TcpStream,
    activity: Arc<Activity>,
}

impl AsyncRead for Watched {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(cx, buf);
        self.activity.moved(buf.filled().len() - before);
        read
    }
}

impl Watched {
    fn noted(&self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        if let Poll::Ready(Ok(bytes)) = written {
            self.activity.moved(bytes);
        }
        written
    }
}

impl AsyncWrite for Watched {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.noted(written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, parts);
        self.noted(written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_and_event_streams_leave_places_to_others() {
        for (requests, subscribers, most) in
            [(64, 256, 1024), (64, 256, 512), (64, 256, 256), (64, 256, 64), (1000, 1, 300), (1, 5000, 1024)]
        {
            let mut limits = LimitsSection { requests, subscribers, ..LimitsSection::default() };
            let wanted = requests + subscribers + SPARE;
            let connections = share(&mut limits, wanted, most);
            assert!(FILES * connections < most, "{most}: {connections}");
            assert!(limits.requests + limits.subscribers < connections, "{most}: {limits:?} {connections}");
            assert!(limits.requests >= 1 && limits.subscribers >= 1, "{most}: {limits:?}");
        }
        let mut limits = LimitsSection::default();
        assert_eq!((share(&mut limits, 384, 1024), limits), (384, LimitsSection::default()));
    }

    #[test]
    fn only_what_counts_gives_a_client_more_time() {
        let activity = Arc::new(Activity::new(Duration::from_secs(20)));
        let begun = activity.waiting();
        std::thread::sleep(Duration::from_millis(1));
        activity.moved(1);
        activity.moved(PROGRESS - 2);
        assert_eq!(activity.waiting(), begun);
        activity.moved(1);
        let moved = activity.waiting();
        assert!(moved > begun);
        std::thread::sleep(Duration::from_millis(1));
        let work = [activity.work(), activity.work()];
        assert_eq!(activity.waiting(), None);
        drop(work);
        assert!(activity.waiting() > moved);
    }
}
