//! Graphics outputs with a connected display.

use super::{Found, Kind, Root, bytes, check, entries, name, quoted, text};
use crate::display::edid::{self, Edid};
use std::path::Path;

/// Connected displays.
pub(super) fn screens(root: &Root) -> Vec<Found> {
    entries(&root.sys.join("class/drm")).iter().filter_map(|folder| screen(root, folder)).collect()
}

fn screen(root: &Root, folder: &Path) -> Option<Found> {
    let file = name(folder);
    let (card, connector) = file.split_once('-')?;
    if !card.starts_with("card") || text(&folder.join("status"))? != "connected" {
        return None;
    }
    let edid = bytes(&folder.join("edid")).and_then(|b| edid::parse(&b).ok());
    let node = root.dev.join("dri").join(card);
    Some(Found {
        kind: Kind::Display,
        what: words(connector, edid.as_ref()),
        id: edid.as_ref().map_or_else(|| file.clone(), Edid::id),
        setting: Some(format!("{{ kind = \"kms\", output = {} }}", quoted(connector))),
        sure: false,
        access: check(root, &node),
        node: Some(node),
        stable: None,
        size_mm: edid.as_ref().and_then(|e| e.size_mm),
        usb: None,
    })
}

fn words(connector: &str, edid: Option<&Edid>) -> String {
    let Some(edid) = edid else { return format!("monitor on {connector}, which does not say what it is") };
    let name = edid.name.as_ref().unwrap_or(&edid.maker);
    let size = edid.size_mm.map_or_else(|| "of unknown size".into(), |[w, h]| format!("{w} mm × {h} mm"));
    format!("monitor {name} on {connector}, {size}")
}
