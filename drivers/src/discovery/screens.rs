//! Outputs of graphics cards with a monitor on them.

use super::{Found, Kind, Root, bytes, check, edid, entries, name, quoted, text};
use std::path::Path;

/// Connected monitors.
pub(super) fn screens(root: &Root) -> Vec<Found> {
    entries(&root.sys.join("class/drm")).iter().filter_map(|folder| screen(root, folder)).collect()
}

fn screen(root: &Root, folder: &Path) -> Option<Found> {
    let file = name(folder);
    let (card, connector) = file.split_once('-')?;
    if !card.starts_with("card") || text(&folder.join("status"))? != "connected" {
        return None;
    }
    let edid = bytes(&folder.join("edid")).and_then(|b| edid::parse(&b));
    let node = root.dev.join("dri").join(card);
    Some(Found {
        kind: Kind::Display,
        what: words(connector, edid.as_ref()),
        id: edid.as_ref().map_or_else(|| file.clone(), identity),
        setting: Some(format!("{{ kind = \"kms\", output = {} }}", quoted(connector))),
        sure: false,
        access: check(root, &node),
        node: Some(node),
        stable: None,
        usb: None,
    })
}

fn words(connector: &str, edid: Option<&edid::Edid>) -> String {
    let Some(edid) = edid else { return format!("monitor on {connector}, which does not say what it is") };
    let name = if edid.name.is_empty() { &edid.maker } else { &edid.name };
    let size = edid.size_mm.map_or_else(|| "of unknown size".into(), |[w, h]| format!("{w} mm × {h} mm"));
    format!("monitor {name} on {connector}, {size}")
}

fn identity(edid: &edid::Edid) -> String {
    let serial = match edid.serial_text.as_str() {
        "" => edid.serial.to_string(),
        text => text.to_owned(),
    };
    format!("{}-{:04x} {serial}", edid.maker, edid.product)
}
