//! Passes commit and target to the program, for `nacre --version`.

use std::process::Command;

fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}

fn main() {
    // The log of HEAD changes with every commit and checkout. An archive of the sources has no log; packagers set
    // NACRE_COMMIT.
    println!("cargo::rerun-if-env-changed=NACRE_COMMIT");
    println!("cargo::rerun-if-changed=build.rs");
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| std::path::Path::new(log).exists()) {
        println!("cargo::rerun-if-changed={log}");
    }
    let given = std::env::var("NACRE_COMMIT").ok();
    let commit = given.or_else(|| git(&["rev-parse", "--short=12", "HEAD"])).unwrap_or_else(|| "unknown".into());
    println!("cargo::rustc-env=NACRE_COMMIT={commit}");
    println!("cargo::rustc-env=NACRE_TARGET={}", std::env::var("TARGET").unwrap_or_default());
}
