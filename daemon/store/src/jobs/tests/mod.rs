//! The queue as the service uses it, with work that a test chooses.

mod kills;

use super::*;
use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tokio::time::{sleep, timeout};

/// Time limit that only a hung machine exceeds.
const PATIENCE: Duration = Duration::from_secs(60);

/// Acts as the option `model` says: succeed, fail at once or permanently, wait for a cancellation, or panic.
fn act(spec: &Spec, progress: &dyn Progress) -> Result<(), Failure> {
    progress.stage("acting", 4);
    match spec.options["model"].as_str().unwrap() {
        "fail" => Err(Failure::Bound("the disk hums".into())),
        "input" => Err(Error::input("upload", "is no photograph", "give another").into()),
        "crash" => panic!("as told"),
        "wait" => {
            progress.step();
            while !progress.cancelled() {
                std::thread::sleep(Duration::from_millis(5));
            }
            Err(Error::Cancelled.into())
        }
        _ => Ok(()),
    }
}

fn spec(model: &str) -> Spec {
    Spec {
        id: ulid::Ulid::generate().to_string(),
        name: String::new(),
        session: Some("s1".into()),
        upload: None,
        light: None,
        results: vec![],
        named: vec![],
        operation: Method::default(),
        options: options(json!({ "model": model, "offset_deg": 1.25, "palette": "hsv" })),
    }
}

fn options(options: Value) -> Map<String, Value> {
    options.as_object().unwrap().clone()
}

async fn open(folder: &Path) -> Jobs {
    Jobs::open(folder, Arc::new(act)).await.unwrap()
}

async fn until(jobs: &Jobs, id: &str, good: impl Fn(&Job) -> bool) -> Job {
    let end = Instant::now() + PATIENCE;
    loop {
        let job = jobs.get(id).await.unwrap().unwrap();
        if good(&job) {
            return job;
        }
        assert!(Instant::now() < end, "still {job:?}\n{}", jobs.log(id).await.unwrap().unwrap());
        sleep(Duration::from_millis(10)).await;
    }
}

async fn reach(jobs: &Jobs, id: &str, state: JobState) -> Job {
    until(jobs, id, |job| job.state == state).await
}

#[tokio::test]
async fn a_job_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let mut changes = jobs.changes();
    let spec = spec("well");
    let job = jobs.submit(spec.clone()).await.unwrap();
    assert_eq!((job.state, job.attempts, job.progress), (JobState::Queued, 0, 0.0));
    assert_eq!((&job.spec, job.session.as_deref()), (&spec, Some("s1")));
    let job = reach(&jobs, &spec.id, JobState::Done).await;
    assert_eq!((job.attempts, job.progress, job.stage.as_str(), job.error), (1, 1.0, "acting", None));
    let now = std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap().as_secs();
    assert!(job.created.abs_diff(now) < 60);
    assert_eq!(timeout(PATIENCE, changes.recv()).await.unwrap().unwrap(), spec.id);
    let log = jobs.log(&spec.id).await.unwrap().unwrap();
    let said: Vec<_> = log.lines().map(|line| line.split_once("Z ").unwrap().1).collect();
    assert_eq!(said, ["queued", "attempt 1 of 3 begins", "stage: acting", "done"]);
    assert!(matches!(jobs.cancel(&spec.id).await, Err(Refusal::State { state: JobState::Done, .. })));
    assert!(matches!(jobs.retry(&spec.id).await, Err(Refusal::State { state: JobState::Done, .. })));
    assert!(matches!(jobs.cancel("01").await, Err(Refusal::Unknown(_))));
    assert_eq!((jobs.get("01").await.unwrap(), jobs.log("01").await.unwrap()), (None, None));
    jobs.shutdown().await;
}

#[tokio::test]
async fn specs_that_cannot_be_kept_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let good = spec("well");
    jobs.submit(good.clone()).await.unwrap();
    let lower = Spec { id: good.id.to_lowercase(), ..good.clone() };
    let nameless = Spec { id: "x".into(), ..good.clone() };
    for bad in [good, lower, nameless] {
        assert!(matches!(jobs.submit(bad).await, Err(Error::Input { .. })));
    }
    assert_eq!(jobs.list(9, None).await.unwrap().0.len(), 1);
    jobs.shutdown().await;
}

#[tokio::test]
async fn progress_shows_and_a_running_or_queued_job_is_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let running = jobs.submit(spec("wait")).await.unwrap().id;
    let queued = jobs.submit(spec("well")).await.unwrap().id;
    let job = until(&jobs, &running, |job| job.progress > 0.0).await;
    assert_eq!((job.state, job.stage.as_str(), job.progress), (JobState::Running, "acting", 0.25));
    let (listed, _) = jobs.list(2, None).await.unwrap();
    assert!(listed.iter().any(|job| job.id == running && job.progress == 0.25));
    assert!(matches!(jobs.retry(&running).await, Err(Refusal::State { state: JobState::Running, .. })));
    assert_eq!(jobs.cancel(&queued).await.unwrap().state, JobState::Cancelled);
    assert_eq!(jobs.cancel(&running).await.unwrap().state, JobState::Running);
    let job = reach(&jobs, &running, JobState::Cancelled).await;
    assert_eq!((job.attempts, job.progress), (1, 0.25));
    // The job was never begun, and the worker continues.
    assert_eq!(jobs.retry(&queued).await.unwrap().attempts, 0);
    assert_eq!(reach(&jobs, &queued, JobState::Done).await.attempts, 1);
    jobs.shutdown().await;
}

#[tokio::test]
async fn a_job_is_forgotten_once_it_has_ended() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let of_upload = |model: &str| Spec { session: None, upload: Some("u1".into()), ..spec(model) };
    let [running, queued] =
        [jobs.submit(of_upload("wait")).await, jobs.submit(of_upload("well")).await].map(|j| j.unwrap().id);
    until(&jobs, &running, |job| job.state == JobState::Running).await;
    for (id, state) in [(&running, JobState::Running), (&queued, JobState::Queued)] {
        assert!(matches!(jobs.remove(id).await, Err(Refusal::State { state: s, .. }) if s == state));
    }
    let uploads = jobs.uploads().await.unwrap();
    assert_eq!((uploads.len(), uploads["u1"].len()), (1, 2));
    // A job cancelled while queued leaves a delivery without effect.
    jobs.cancel(&queued).await.unwrap();
    jobs.remove(&queued).await.unwrap();
    jobs.cancel(&running).await.unwrap();
    reach(&jobs, &running, JobState::Cancelled).await;
    jobs.remove(&running).await.unwrap();
    assert!(matches!(jobs.remove(&running).await, Err(Refusal::Unknown(_))));
    assert!(jobs.get(&running).await.unwrap().is_none() && jobs.log(&running).await.unwrap().is_none());
    assert!(jobs.uploads().await.unwrap().is_empty());
    let next = jobs.submit(spec("well")).await.unwrap().id;
    reach(&jobs, &next, JobState::Done).await;
    assert_eq!(jobs.list(9, None).await.unwrap().0.len(), 1);
    jobs.shutdown().await;
}

#[tokio::test]
async fn a_failing_job_is_set_aside_with_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    for (model, error) in [("fail", "the disk hums"), ("crash", "as told")] {
        let id = jobs.submit(spec(model)).await.unwrap().id;
        let job = reach(&jobs, &id, JobState::SetAside).await;
        assert_eq!(job.attempts, MAX_ATTEMPTS);
        assert!(job.error.unwrap().contains(error));
        let log = jobs.log(&id).await.unwrap().unwrap();
        for attempt in 1..=MAX_ATTEMPTS {
            assert!(log.contains(&format!("attempt {attempt} of 3 begins")), "{log}");
        }
        assert!(log.matches(error).count() == 3 && log.contains("set aside"), "{log}");
        let job = jobs.retry(&id).await.unwrap();
        assert_eq!((job.state, job.attempts, job.error), (JobState::Queued, 0, None));
        assert_eq!(reach(&jobs, &id, JobState::SetAside).await.attempts, MAX_ATTEMPTS);
    }
    jobs.shutdown().await;
}

#[tokio::test]
async fn bad_input_is_not_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let id = jobs.submit(spec("input")).await.unwrap().id;
    let job = reach(&jobs, &id, JobState::Failed).await;
    assert_eq!((job.attempts, job.error.as_deref()), (1, Some("upload: is no photograph; give another")));
    jobs.retry(&id).await.unwrap();
    reach(&jobs, &id, JobState::Failed).await;
    jobs.shutdown().await;
}

#[tokio::test]
async fn jobs_are_done_in_turn_and_listed_in_pages() {
    let folder = tempfile::tempdir().unwrap();
    let (order, count) = (Arc::new(std::sync::Mutex::new(Vec::new())), Arc::new(AtomicUsize::new(0)));
    let (seen, at_once) = (order.clone(), count.clone());
    let work: Work = Arc::new(move |spec, _| {
        assert_eq!(at_once.fetch_add(1, Ordering::SeqCst), 0);
        seen.lock().unwrap().push(spec.id.clone());
        std::thread::sleep(Duration::from_millis(2));
        at_once.fetch_sub(1, Ordering::SeqCst);
        Ok(())
    });
    let jobs = Jobs::open(folder.path(), work).await.unwrap();
    let mut ids: Vec<_> = (0..7).map(|_| spec("well")).collect();
    // As if the clock had been set back before each: the order is that of submission.
    ids.sort_by(|a, b| b.id.cmp(&a.id));
    let mut expected = Vec::new();
    for spec in ids {
        expected.push(jobs.submit(spec).await.unwrap().id);
    }
    reach(&jobs, &expected[6], JobState::Done).await;
    assert_eq!(*order.lock().unwrap(), expected);
    let (mut pages, mut after) = (Vec::new(), None);
    loop {
        let (page, next) = jobs.list(3, after.as_deref()).await.unwrap();
        pages.push(page.len());
        order.lock().unwrap().extend(page.into_iter().map(|job| job.id));
        after = next;
        if after.is_none() {
            break;
        }
    }
    assert_eq!(pages, [3, 3, 1]);
    assert_eq!(order.lock().unwrap()[7..], expected);
    jobs.shutdown().await;
}

#[tokio::test]
async fn a_log_stays_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let work: Work = Arc::new(|_, progress| {
        progress.stage("beginning", 0);
        Err(Failure::Bound(format!("{}\n{}", "ä".repeat(20_000), progress.cancelled())))
    });
    let jobs = Jobs::open(folder.path(), work).await.unwrap();
    let id = jobs.submit(spec("")).await.unwrap().id;
    reach(&jobs, &id, JobState::SetAside).await;
    let log = jobs.log(&id).await.unwrap().unwrap();
    assert!(log.len() <= MAX_LOG && log.len() > MAX_LOG / 2, "{}", log.len());
    assert!(log.starts_with("20") && log.ends_with("set aside: no attempt is left\n") && !log.contains("attempt 1"));
    jobs.shutdown().await;
}

#[tokio::test]
async fn shutdown_puts_the_running_job_back() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let first = jobs.submit(spec("wait")).await.unwrap().id;
    let second = jobs.submit(spec("well")).await.unwrap().id;
    until(&jobs, &first, |job| job.progress > 0.0).await;
    assert!(matches!(Jobs::open(folder.path(), Arc::new(act)).await, Err(Error::Input { .. })));
    jobs.shutdown().await;
    jobs.shutdown().await;
    assert!(matches!(jobs.get(&first).await, Err(Error::Cancelled)));

    let ended: Work = Arc::new(|_, _| Ok(()));
    let jobs = Jobs::open(folder.path(), ended).await.unwrap();
    assert_eq!(reach(&jobs, &first, JobState::Done).await.attempts, 1);
    reach(&jobs, &second, JobState::Done).await;
    assert!(jobs.log(&first).await.unwrap().unwrap().contains("does not count"));
    // Dropping stops the worker and unlocks the folder.
    drop(jobs);
    let end = Instant::now() + PATIENCE;
    while worker::lock(folder.path()).await.is_err() {
        assert!(Instant::now() < end);
        sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test]
async fn other_files_are_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("jobs.db");
    let refuse = async |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let error = Jobs::open(folder.path(), Arc::new(act)).await.err().unwrap();
        assert!(matches!(error, Error::Input { .. }), "{error}");
        assert!(error.to_string().contains("jobs.db") && error.to_string().contains(store::AWAY), "{error}");
        assert_eq!(fs::read(&path).unwrap(), bytes);
        error.to_string()
    };
    assert!(refuse(&[b'x'; 9000]).await.contains("no intact"));

    // The catalogue is SQLite as well, but a different database.
    let other = folder.path().join("catalogue.db");
    crate::catalogue::Catalogue::open(&other).await.unwrap().close().await;
    assert!(refuse(&fs::read(&other).unwrap()).await.contains("another program"));

    fs::remove_file(&path).unwrap();
    let jobs = open(folder.path()).await;
    let id = jobs.submit(spec("well")).await.unwrap().id;
    reach(&jobs, &id, JobState::Done).await;
    jobs.shutdown().await;
    // The last connection is closed in a separate thread; only then does this one file contain everything.
    let end = Instant::now() + PATIENCE;
    while folder.path().join("jobs.db-wal").exists() {
        assert!(Instant::now() < end);
        sleep(Duration::from_millis(10)).await;
    }
    let whole = fs::read(&path).unwrap();
    let mut damaged = whole.clone();
    let middle = whole.len() / 3;
    damaged[4096..middle].fill(0x5a);
    assert!(refuse(&damaged).await.contains("no intact"));
    let mut newer = whole.clone();
    newer[63] = 9;
    assert!(refuse(&newer).await.contains("version 9"));
    fs::write(&path, whole).unwrap();
    let jobs = open(folder.path()).await;
    assert_eq!(jobs.get(&id).await.unwrap().unwrap().state, JobState::Done);
    jobs.shutdown().await;
}

#[tokio::test]
async fn a_worker_that_fails_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let id = jobs.submit(spec("well")).await.unwrap().id;
    reach(&jobs, &id, JobState::Done).await;
    let pool = jobs.shared.store.pool();
    let workers = async || sqlx::query_scalar::<_, String>("SELECT id FROM Workers").fetch_all(pool).await.unwrap();
    let first = workers().await;
    let id = jobs.submit(spec("wait")).await.unwrap().id;
    until(&jobs, &id, |job| job.progress > 0.0).await;
    // Its next heartbeat fails; the job continues.
    sqlx::raw_sql("DELETE FROM Jobs; DELETE FROM Workers").execute(pool).await.unwrap();
    let end = Instant::now() + PATIENCE;
    while workers().await.is_empty() {
        assert!(Instant::now() < end);
        sleep(Duration::from_millis(10)).await;
    }
    assert_ne!(workers().await, first);
    jobs.cancel(&id).await.unwrap();
    assert_eq!(reach(&jobs, &id, JobState::Cancelled).await.attempts, 1);
    let id = jobs.submit(spec("well")).await.unwrap().id;
    reach(&jobs, &id, JobState::Done).await;
    jobs.shutdown().await;
}

#[tokio::test]
async fn a_removed_job_is_restored_with_its_name_and_log() {
    let home = tempfile::tempdir().unwrap();
    let jobs = Jobs::open(home.path(), Arc::new(|_, _| Ok(()))).await.unwrap();
    let id = jobs.submit(spec("m")).await.unwrap().id;
    while jobs.get(&id).await.unwrap().unwrap().state != JobState::Done {
        sleep(Duration::from_millis(5)).await;
    }
    let job = jobs.rename(&id, "Scheibe „7“").await.unwrap();
    assert_eq!(job.spec, Spec { name: "Scheibe „7“".into(), id: id.clone(), ..spec("m") });
    let saved = jobs.saved(&id).await.unwrap().unwrap();
    let log = jobs.log(&id).await.unwrap();
    jobs.remove(&id).await.unwrap();
    assert_eq!(jobs.saved(&id).await.unwrap(), None);
    // It is stored as JSON.
    let saved: Saved = serde_json::from_str(&serde_json::to_string(&saved).unwrap()).unwrap();
    for _ in 0..2 {
        jobs.restore(&saved).await.unwrap();
    }
    assert_eq!((jobs.get(&id).await.unwrap(), jobs.log(&id).await.unwrap()), (Some(job), log));
    jobs.restore(&Saved { state: JobState::Queued, ..saved }).await.unwrap_err();
    assert!(matches!(jobs.rename("none", "x").await, Err(Refusal::Unknown(_))));
}

#[tokio::test]
async fn a_waiting_job_is_moved_to_the_front() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = open(folder.path()).await;
    let mut ids = vec![];
    for model in ["wait", "well", "well", "well"] {
        ids.push(jobs.submit(spec(model)).await.unwrap().id);
    }
    until(&jobs, &ids[0], |job| job.state == JobState::Running).await;
    let places = async |jobs: &Jobs| {
        let queue = jobs.queue().await.unwrap();
        queue.iter().map(|job| ids.iter().position(|id| *id == job.id).unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(places(&jobs).await, [0, 1, 2, 3]);
    jobs.to_the_front(&ids[3]).await.unwrap();
    assert_eq!(places(&jobs).await, [0, 3, 1, 2]);
    assert!(matches!(jobs.to_the_front(&ids[0]).await, Err(Refusal::State { state: JobState::Running, .. })));
    assert!(matches!(jobs.to_the_front("01ARZ3NDEKTSV4RRFFQ69G5FAV").await, Err(Refusal::Unknown(_))));
    // The order outlives the process; the interrupted job is first.
    jobs.shutdown().await;
    let jobs = open(folder.path()).await;
    until(&jobs, &ids[0], |job| job.state == JobState::Running).await;
    assert_eq!(places(&jobs).await, [0, 3, 1, 2]);
    // A file of an earlier version has no turns: jobs run in the order of submission.
    jobs.shutdown().await;
    let file = crate::sqlite::pool().connect_lazy_with(crate::sqlite::options(&folder.path().join("jobs.db")));
    sqlx::raw_sql("ALTER TABLE nacre_job DROP COLUMN turn").execute(&file).await.unwrap();
    file.close().await;
    let jobs = open(folder.path()).await;
    until(&jobs, &ids[0], |job| job.state == JobState::Running).await;
    assert_eq!(places(&jobs).await, [0, 1, 2, 3]);
    jobs.to_the_front(&ids[2]).await.unwrap();
    jobs.cancel(&ids[0]).await.unwrap();
    for id in &ids[1..] {
        reach(&jobs, id, JobState::Done).await;
    }
    assert_eq!(places(&jobs).await, [0; 0]);
    jobs.shutdown().await;
}
