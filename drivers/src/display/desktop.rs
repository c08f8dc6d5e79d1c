//! Detection of desktop programs that change a display during a measurement: they blank the screen, tint it at night,
//! and dim it.

/// Process names and their effects. The kernel truncates names to 15 characters.
const MEDDLERS: [(&str, &str); 12] = [
    (
        "gnome-shell",
        "GNOME may blank the screen, and tint it at night: switch off Screen Blank, Night Light and automatic brightness",
    ),
    ("plasmashell", "KDE may blank the screen, and tint it at night: switch off Screen Energy Saving and Night Light"),
    ("cinnamon", "Cinnamon may blank the screen: switch off the screensaver and Night Light"),
    ("xfce4-power-man", "XFCE may blank the screen: switch on its presentation mode"),
    ("redshift", "redshift tints the screen: end it"),
    ("gammastep", "gammastep tints the screen: end it"),
    ("wlsunset", "wlsunset tints the screen: end it"),
    ("swayidle", "swayidle may blank the screen: end it"),
    ("hypridle", "hypridle may blank the screen: end it"),
    ("xscreensaver", "xscreensaver may cover the screen: end it"),
    ("light-locker", "light-locker may blank the screen: end it"),
    ("clight", "clight changes the brightness: end it"),
];

/// Maximum number of examined processes.
const MAX_PROCESSES: usize = 65_536;

/// Warnings about running programs that may change the display's picture during a measurement, for the user to switch
/// off.
pub fn desktop_warnings() -> Vec<String> {
    let names = std::fs::read_dir("/proc").into_iter().flatten().flatten().take(MAX_PROCESSES).filter_map(|entry| {
        let number = entry.file_name().to_string_lossy().bytes().all(|b| b.is_ascii_digit());
        number.then(|| std::fs::read_to_string(entry.path().join("comm")).ok()).flatten()
    });
    warnings(std::env::var("XDG_SESSION_TYPE").ok().as_deref(), names)
}

fn warnings(session: Option<&str>, processes: impl Iterator<Item = String>) -> Vec<String> {
    let mut found = Vec::new();
    for name in processes {
        let warning = MEDDLERS.iter().find(|(meddler, _)| name.trim() == *meddler).map(|(_, does)| (*does).to_owned());
        if let Some(warning) = warning.filter(|s| !found.contains(s)) {
            found.push(warning);
        }
    }
    if found.is_empty() && matches!(session, Some("x11")) {
        found.push("X11 blanks the screen after ten minutes: run `xset s off -dpms`".to_owned());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfering_programs_are_named_once() {
        let running = ["init\n", "redshift\n", "gnome-shell\n", "redshift\n", "not-redshift\n"].map(str::to_owned);
        let warning = warnings(Some("wayland"), running.into_iter());
        assert!(
            warning.len() == 2 && warning[0].contains("redshift") && warning[1].contains("Night Light"),
            "{warning:?}"
        );
        assert!(warnings(Some("x11"), std::iter::empty())[0].contains("xset"));
        assert!(warnings(None, std::iter::empty()).is_empty());
    }

    #[test]
    fn names_are_not_longer_than_the_kernel_keeps_them() {
        assert!(MEDDLERS.iter().all(|(name, _)| name.len() <= 15));
        desktop_warnings();
    }
}
