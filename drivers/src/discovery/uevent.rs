//! The `uevent` file of a HID device: lines of `KEY=value`.

/// Identity of a HID device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Uevent {
    /// Bus, vendor and product.
    pub id: Option<(u16, u16, u16)>,
    /// Manufacturer and product in one string.
    pub name: String,
    /// Serial number; empty if there is none.
    pub serial: String,
}

/// Maximum length of a stored name or serial number.
const MAX_TEXT: usize = 256;

/// Parses a `uevent` file; missing keys stay empty.
pub fn parse(text: &str) -> Uevent {
    let mut read = Uevent::default();
    for line in text.lines() {
        let Some((key, value)) = line.split_once('=') else { continue };
        let kept = || value.trim().chars().filter(|c| !c.is_control()).take(MAX_TEXT).collect::<String>();
        match key {
            "HID_ID" => read.id = id(value),
            "HID_NAME" => read.name = kept(),
            "HID_UNIQ" => read.serial = kept(),
            _ => {}
        }
    }
    read
}

/// `0003:000016C0:000005DF`: bus, vendor, product.
fn id(text: &str) -> Option<(u16, u16, u16)> {
    let mut parts = text.trim().split(':').map(|part| u32::from_str_radix(part, 16).ok()?.try_into().ok());
    let id = (parts.next()??, parts.next()??, parts.next()??);
    parts.next().is_none().then_some(id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_relay_is_read_as_the_kernel_writes_it() {
        let text = "DRIVER=hid-generic\nHID_ID=0003:000016C0:000005DF\nHID_NAME=www.dcttech.com USBRelay2\n\
                    HID_PHYS=usb-0000:00:14.0-1/input0\nHID_UNIQ=\nMODALIAS=hid:b0003g0001v000016C0p000005DF\n";
        let read = parse(text);
        assert_eq!(read.id, Some((3, 0x16c0, 0x05df)));
        assert_eq!((read.name.as_str(), read.serial.as_str()), ("www.dcttech.com USBRelay2", ""));
    }

    #[test]
    fn odd_numbers_are_none() {
        for odd in ["HID_ID=", "HID_ID=3:4", "HID_ID=3:4:5:6", "HID_ID=x:1:2", "HID_ID=0003:FFFF16C0:000005DF"] {
            assert_eq!(parse(odd).id, None, "{odd}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_read(text in ".{0,400}") {
            parse(&text);
        }

        #[test]
        fn written_events_are_read(vendor: u16, product: u16, name in "[a-zA-Z0-9 .]{0,40}", serial in "[A-Z0-9]{0,20}") {
            let text = format!("HID_ID=0003:{vendor:08X}:{product:08X}\nHID_NAME={name}\nHID_UNIQ={serial}\n");
            let read = parse(&text);
            prop_assert_eq!(read.id, Some((3, vendor, product)));
            prop_assert_eq!(read.name.as_str(), name.trim());
            prop_assert_eq!(read.serial, serial);
        }
    }
}
