//! udev rules that give users at the machine access to the devices of a bench, under stable names.

/// Content of `/etc/udev/rules.d/70-nacre.rules`; the number sorts it before 73-seat-late, which acts on `uaccess`.
pub fn udev_rules() -> &'static str {
    "\
# Devices of Nacre: whoever sits at the machine may open them, and so may the groups below (over ssh).
# After a change: sudo udevadm control --reload && sudo udevadm trigger

# Relays (DCTTech, HIDRelay), also by USB port, such as nacre-relay-1-2: some have no serial number. The numbers of
# DCTTech are shared with other devices, its product is not.
KERNEL==\"hidraw*\", ATTRS{idVendor}==\"16c0\", ATTRS{idProduct}==\"05df\", ATTRS{product}==\"USBRelay*\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-relay nacre-relay-$id\"
KERNEL==\"hidraw*\", ATTRS{idVendor}==\"0519\", ATTRS{idProduct}==\"2018\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-relay nacre-relay-$id\"

# blink(1)
KERNEL==\"hidraw*\", ATTRS{idVendor}==\"27b8\", ATTRS{idProduct}==\"01ed\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-blink1-$attr{serial}\"

# Flash with bulk transfers
SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", ATTR{idVendor}==\"1209\", ATTR{idProduct}==\"0001\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-flash-$attr{serial}\"

# Elliptec interface (FTDI FT231X) and GRBL controllers (CH340, Arduino)
SUBSYSTEM==\"tty\", ATTRS{idVendor}==\"0403\", ATTRS{idProduct}==\"6015\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-elliptec-$attr{serial}\"
SUBSYSTEM==\"tty\", ATTRS{idVendor}==\"1a86\", ATTRS{idProduct}==\"7523\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-grbl\"
SUBSYSTEM==\"tty\", ATTRS{idVendor}==\"2341\", \\
  MODE=\"0660\", GROUP=\"dialout\", TAG+=\"uaccess\", SYMLINK+=\"nacre-grbl-$attr{serial}\"

# ModemManager writes to serial ports that it does not know, which moves stages. Only these three are kept from it:
# for another adapter add a line with its numbers (lsusb), or remove ModemManager.
ATTRS{idVendor}==\"0403\", ATTRS{idProduct}==\"6015\", ENV{ID_MM_DEVICE_IGNORE}=\"1\"
ATTRS{idVendor}==\"1a86\", ATTRS{idProduct}==\"7523\", ENV{ID_MM_DEVICE_IGNORE}=\"1\"
ATTRS{idVendor}==\"2341\", ENV{ID_MM_DEVICE_IGNORE}=\"1\"

# Cameras of V4L2, and of USB3 Vision
SUBSYSTEM==\"video4linux\", MODE=\"0660\", GROUP=\"video\", TAG+=\"uaccess\"
SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", ENV{ID_USB_INTERFACES}==\"*:ef0500:*\", \\
  MODE=\"0660\", GROUP=\"video\", TAG+=\"uaccess\"

# Digital cameras (Picture Transfer Protocol)
SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", ENV{ID_USB_INTERFACES}==\"*:060101:*\", \\
  MODE=\"0660\", GROUP=\"video\", TAG+=\"uaccess\"
"
}

#[cfg(test)]
mod tests {
    use super::udev_rules;

    /// udev ends a rule at the line's end unless the last character is a backslash, and accepts only double quotes.
    #[test]
    fn every_rule_matches_and_assigns() {
        let joined = udev_rules().replace("\\\n", "");
        let rules: Vec<&str> = joined.lines().filter(|l| !l.is_empty() && !l.starts_with('#')).collect();
        assert!(rules.len() >= 10);
        for rule in rules {
            assert!(rule.contains("==\"") && (rule.contains("uaccess") || rule.contains("IGNORE")), "{rule}");
            assert_eq!(rule.matches('"').count() % 2, 0, "{rule}");
            for part in rule.split(", ") {
                assert!(part.trim().contains('=') && part.trim().ends_with('"'), "{part}");
            }
        }
    }
}
