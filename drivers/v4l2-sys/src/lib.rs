//! Bindings of the kernel's V4L2 interface (`linux/videodev2.h`), for the crate `v4l` on 64-bit Linux.
//!
//! `generate` writes them. They contain the size and the offsets of every structure, which the compiler compares with
//! its own: a target with another layout is refused.
#![cfg(all(target_os = "linux", target_pointer_width = "64"))]
#![allow(clippy::all, missing_docs, non_camel_case_types, non_snake_case, non_upper_case_globals)]

include!("bindings.rs");
