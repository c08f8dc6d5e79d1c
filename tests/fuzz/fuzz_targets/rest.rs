//! Requests to the service with a simulated bench: method, path and query on the first line, then the body.
#![no_main]

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{Request, StatusCode};
use libfuzzer_sys::fuzz_target;
use nacre_capture::rig::Place;
use nacre_service::config::Config;
use nacre_sim::BenchConfig;
use std::sync::OnceLock;
use tokio::runtime::{Builder, Runtime};
use tower::ServiceExt;

const BENCH: &str = "camera = { width = 8, height = 6 }";

/// Endless event streams.
const ENDLESS: [&str; 2] = ["/events", "/display/link"];

fn open() -> (Runtime, Router) {
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
    let config = Config { data: nacre_fuzz::folder().join("data"), ..Config::default() };
    let bench = BenchConfig::from_toml(BENCH).expect("the bench above can be read");
    let router = runtime.block_on(nacre_service::in_process(config, Place::here(bench))).expect("a service");
    (runtime, router)
}

fuzz_target!(|bytes: &[u8]| {
    static SERVICE: OnceLock<(Runtime, Router)> = OnceLock::new();
    let (runtime, router) = SERVICE.get_or_init(open);
    let mut parts = bytes.splitn(2, |b| *b == b'\n');
    let [line, body] = std::array::from_fn(|_| parts.next().unwrap_or_default());
    let Some((method, path)) = std::str::from_utf8(line).ok().and_then(|line| line.split_once(' ')) else { return };
    if ENDLESS.iter().any(|stream| path.contains(stream)) {
        return;
    }
    let send = |method: &str, path: &str, body: &[u8]| {
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header("host", "127.0.0.1")
            .header(
                "content-type",
                if path.starts_with("/api/v1/uploads") && body.starts_with(b"--b") {
                    "multipart/form-data; boundary=b"
                } else {
                    "application/json"
                },
            )
            .body(Body::from(body.to_vec()));
        let Ok(request) = request else { return };
        runtime.block_on(async {
            let response = router.clone().oneshot(request).await.expect("an answer, whatever was asked");
            let status = response.status();
            let body = to_bytes(response.into_body(), 64 << 20).await;
            assert_ne!(status, StatusCode::INTERNAL_SERVER_ERROR, "{body:?}");
        });
    };
    send(method, path, body);
    // A session would continue and fill the memory.
    if method == "POST" && path.contains("/sessions") {
        send("POST", "/api/v1/stop", b"");
    }
});
