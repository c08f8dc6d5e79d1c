//! Processes that end during a job.

use super::*;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::AtomicBool;

/// Dropping the runtime does not end the thread of a job: until that thread ends, no other queue can open the folder.
#[test]
fn a_job_whose_thread_lives_on_is_not_done_twice_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = || tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    let end = Arc::new(AtomicBool::new(false));
    let ended = end.clone();
    let work: Work = Arc::new(move |_, progress| {
        progress.stage("deaf", 1);
        while !ended.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    });
    let first = runtime();
    let id = first.block_on(async {
        let jobs = Jobs::open(folder.path(), work).await.unwrap();
        let id = jobs.submit(spec("")).await.unwrap().id;
        until(&jobs, &id, |job| job.stage == "deaf").await;
        id
    });
    first.shutdown_background();
    runtime().block_on(async {
        assert!(matches!(Jobs::open(folder.path(), Arc::new(act)).await, Err(Error::Input { .. })));
        end.store(true, Ordering::SeqCst);
        let limit = Instant::now() + PATIENCE;
        let jobs = loop {
            match Jobs::open(folder.path(), Arc::new(act)).await {
                Ok(jobs) => break jobs,
                Err(e) => assert!(Instant::now() < limit, "{e}"),
            }
            sleep(Duration::from_millis(10)).await;
        };
        assert_eq!(reach(&jobs, &id, JobState::Done).await.attempts, 2);
        jobs.shutdown().await;
    });
}

/// Not a test: a process that works on a folder and is killed by the tests below.
#[test]
#[ignore = "started by other tests"]
fn victim() {
    let Some(folder) = std::env::var_os("NACRE_JOBS_VICTIM").map(PathBuf::from) else { return };
    let busy = std::env::var_os("NACRE_JOBS_BUSY").is_some();
    let mark = folder.join("begun");
    let work: Work = Arc::new(move |_, _| {
        fs::write(&mark, "").unwrap();
        std::thread::sleep(if busy { Duration::from_millis(1) } else { PATIENCE });
        Ok(())
    });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(async {
        let jobs = Jobs::open(&folder, work).await.unwrap();
        let mut known = fs::File::options().create(true).append(true).open(folder.join("known")).unwrap();
        if !busy {
            return sleep(PATIENCE).await;
        }
        // The tests below must be able to finish all jobs.
        for _ in 0..10 {
            let id = jobs.submit(spec("well")).await.unwrap().id;
            writeln!(known, "{id}").unwrap();
        }
        sleep(PATIENCE).await;
    });
}

/// Starts a process that works on the folder, and kills it this time after it has begun a job.
fn kill_in_the_middle(folder: &Path, busy: bool, after: Duration) {
    let mark = folder.join("begun");
    let _ = fs::remove_file(&mark);
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--ignored", "--exact", "jobs::tests::kills::victim"]).env("NACRE_JOBS_VICTIM", folder);
    if busy {
        command.env("NACRE_JOBS_BUSY", "1");
    }
    let mut process = command.stdout(Stdio::null()).spawn().unwrap();
    let end = Instant::now() + PATIENCE;
    while !mark.exists() && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(after);
    process.kill().unwrap();
    process.wait().unwrap();
    assert!(mark.exists());
}

#[tokio::test]
async fn no_job_is_lost_in_kills_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    for milliseconds in [0, 7, 13, 29, 41, 63] {
        kill_in_the_middle(folder.path(), true, Duration::from_millis(milliseconds));
    }
    let jobs = open(folder.path()).await;
    let known = fs::read_to_string(folder.path().join("known")).unwrap();
    assert!(known.lines().count() > 6, "{known}");
    for id in known.lines() {
        until(&jobs, id, |job| matches!(job.state, JobState::Done | JobState::Failed)).await;
    }
    jobs.shutdown().await;
}

#[tokio::test]
async fn kills_count_as_attempts() {
    let folder = tempfile::tempdir().unwrap();
    // A queue that stops at once leaves the job to the next processes.
    let store = Store::open(&folder.path().join("jobs.db")).await.unwrap();
    let id = store.insert(spec("well")).await.unwrap().id;
    store.close().await;

    kill_in_the_middle(folder.path(), false, Duration::ZERO);
    let jobs = open(folder.path()).await;
    assert_eq!(reach(&jobs, &id, JobState::Done).await.attempts, 2);
    assert!(jobs.log(&id).await.unwrap().unwrap().contains("killed"));
    let id = jobs.submit(spec("wait")).await.unwrap().id;
    until(&jobs, &id, |job| job.progress > 0.0).await;
    jobs.shutdown().await;

    for _ in 0..MAX_CUT_OFF {
        kill_in_the_middle(folder.path(), false, Duration::ZERO);
    }
    let jobs = open(folder.path()).await;
    let job = jobs.get(&id).await.unwrap().unwrap();
    assert_eq!((job.state, job.attempts), (JobState::Failed, MAX_CUT_OFF));
    assert!(job.error.unwrap().contains("killed"));
    let retried = jobs.retry(&id).await.unwrap();
    assert_eq!((retried.state, retried.attempts), (JobState::Queued, 0));
    jobs.shutdown().await;
}

#[tokio::test]
async fn a_cancelled_job_stays_so_after_a_kill() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("jobs.db")).await.unwrap();
    let id = store.insert(spec("well")).await.unwrap().id;
    store.change(&id, Record::begin).await.unwrap().unwrap().unwrap();
    store.change(&id, Record::cancel).await.unwrap().unwrap().unwrap();
    store.close().await;
    let jobs = open(folder.path()).await;
    assert_eq!(jobs.get(&id).await.unwrap().unwrap().state, JobState::Cancelled);
    jobs.shutdown().await;
}
