//! Common code of the program's fuzz targets.
#![cfg(feature = "program")]

use nacre_base::guard::guarded;
use nacre_image::{details, encode_png16_gray, exposure, info, read, size};
use std::backtrace::Backtrace;
use std::panic::{set_hook, take_hook};
use std::path::{Path, PathBuf};
use std::sync::{Once, OnceLock};

/// Folder of this process for its inputs, created at the first call. `run` keeps it in memory, and removes it.
///
/// From that call on, a panic in code of this project ends the process, although the program would catch it.
/// Third-party decoders may panic in a guard, but our code may not.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        report_own_panics();
        let folder = std::env::temp_dir().join(format!("nacre-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("TMPDIR takes files");
        folder
    })
}

/// Writes a file into [`folder`].
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder().join(name);
    std::fs::write(&path, bytes).expect("TMPDIR takes files");
    path
}

/// Writes the photographs of a short session into [`folder`], once.
pub fn photographs() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        std::fs::create_dir_all(folder().join("frames")).expect("TMPDIR takes folders");
        let png = encode_png16_gray(4, 2, &[0, 64, 1000, 2000, 4095, 300, 500, 700]).expect("a picture");
        for k in 0..8 {
            file(&format!("frames/{k:04}.png"), &png);
        }
    });
}

fn report_own_panics() {
    // Its panic hook is installed at the first call, and would hide ours.
    let _ = guarded(|| ());
    let others = take_hook();
    set_hook(Box::new(move |panic| {
        if panic.location().is_some_and(|at| at.file().contains("/registry/src/")) {
            return others(panic);
        }
        eprintln!("{panic}\n{}", Backtrace::force_capture());
        std::process::abort();
    }));
}

/// All program functions applied to a photograph.
pub fn photograph(path: &Path) {
    let (stated, header) = (size(path), info(path));
    if let (Ok(stated), Ok(header)) = (&stated, &header) {
        assert_eq!(*stated, [header.width, header.height]);
    }
    if let Ok(raster) = read(path) {
        assert_eq!(raster.info(), header.expect("a file that is read has a header"));
    }
    let _ = details(path);
    let _ = exposure(path);
}
