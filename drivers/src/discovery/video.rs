//! V4L2 cameras.

use super::{Found, Kind, Root, Usb, check, entries, name, quoted, stable_name, text};
use std::path::Path;

/// Cameras. Only the first of a camera's nodes delivers pictures.
pub(super) fn cameras(root: &Root) -> Vec<Found> {
    entries(&root.sys.join("class/video4linux")).iter().filter_map(|folder| camera(root, folder)).collect()
}

fn camera(root: &Root, folder: &Path) -> Option<Found> {
    let file = name(folder);
    let first = text(&folder.join("index")).is_none_or(|index| index == "0");
    if !first || !file.starts_with("video") {
        return None;
    }
    let node = root.dev.join(&file);
    let usb = Usb::of(root, &folder.join("device"));
    let stable = stable_name(root, "v4l", &file, usb.as_ref());
    let path = stable.as_ref().unwrap_or(&node);
    Some(Found {
        kind: Kind::Camera,
        what: text(&folder.join("name")).unwrap_or_else(|| "camera".into()),
        id: usb.as_ref().map_or_else(|| file.clone(), Usb::identity),
        setting: Some(format!("{{ kind = \"v4l2\", device = {} }}", quoted(&path.to_string_lossy()))),
        sure: true,
        access: check(root, &node),
        node: Some(node),
        stable,
        size_mm: None,
        usb,
    })
}
