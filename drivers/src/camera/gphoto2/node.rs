//! Interface between the driver and a camera of libgphoto2.

/// Result of a call on a camera.
pub type NodeResult<T> = Result<T, Failure>;

/// A call on a camera failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Cause.
    pub cause: Cause,
    /// The library's message.
    pub text: String,
}

/// Cause of a failed call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The library cannot be loaded.
    Library,
    /// No such camera is connected.
    Missing,
    /// Several cameras fit the settings.
    Several,
    /// Another program uses the camera.
    Held,
    /// This user may not open the camera.
    Denied,
    /// The camera does not answer, or was unplugged.
    Gone,
    /// The battery is low.
    Battery,
    /// The memory card is full.
    CardFull,
    /// There is no memory card.
    NoCard,
    /// The memory card is write-protected or not formatted.
    CardProtected,
    /// The lens cap is on, or the lens is not ready.
    Lens,
    /// The mirror is locked up.
    Mirror,
    /// The autofocus found no focus.
    Focus,
    /// The camera is busy.
    Busy,
    /// The shutter is set to bulb or time.
    Bulb,
    /// A file is larger than permitted.
    TooLarge,
    /// The camera lacks this setting or refuses this value.
    Unsupported,
    /// Any other cause.
    Other,
}

impl Failure {
    /// A failure with this cause.
    pub fn new(cause: Cause, text: impl Into<String>) -> Self {
        Self { cause, text: text.into() }
    }

    /// A failure with a result code of the library and the messages that the library gave with it.
    pub fn of(code: i32, meaning: &str, messages: &str) -> Self {
        let text = if messages.is_empty() { meaning.to_owned() } else { messages.to_owned() };
        Self { cause: cause(code, messages), text: format!("{text} (code {code})") }
    }
}

/// Parts of the library's messages, with their meaning. The library has no codes for these.
const MESSAGES: [(&str, Cause); 27] = [
    ("ran full", Cause::CardFull),
    ("store full", Cause::CardFull),
    ("no more memory", Cause::CardFull),
    ("card full", Cause::CardFull),
    ("no card", Cause::NoCard),
    ("store not available", Cause::NoCard),
    ("read-only", Cause::CardProtected),
    ("store read only", Cause::CardProtected),
    ("write protected", Cause::CardProtected),
    ("card protected", Cause::CardProtected),
    ("unformatted", Cause::CardProtected),
    ("card error", Cause::CardProtected),
    ("low battery", Cause::Battery),
    ("battery low", Cause::Battery),
    ("battery exhausted", Cause::Battery),
    ("lens cover", Cause::Lens),
    ("lens is retracting", Cause::Lens),
    ("mirror up", Cause::Mirror),
    ("mirror-up", Cause::Mirror),
    ("mirrorup", Cause::Mirror),
    ("no focus", Cause::Focus),
    ("out of focus", Cause::Focus),
    ("auto-focus", Cause::Focus),
    ("did not focus", Cause::Focus),
    ("speed bulb", Cause::Bulb),
    ("bulb warning", Cause::Bulb),
    ("shutter speed time", Cause::Bulb),
];

/// Cause of a result code (`GP_ERROR_…`), or of the message where the code is general.
pub fn cause(code: i32, messages: &str) -> Cause {
    let messages = messages.to_lowercase();
    // A message may contain several of these; the order above decides.
    if let Some((_, cause)) = MESSAGES.iter().find(|(part, _)| messages.contains(part)) {
        return *cause;
    }
    match code {
        -115 => Cause::CardFull,
        -110 => Cause::Busy,
        -105 => Cause::Missing,
        -60 | -53 => Cause::Held,
        -7 | -10 | -34 | -35 | -37 | -51 | -52 => Cause::Gone,
        -2 | -6 => Cause::Unsupported,
        -4 => Cause::Library,
        _ => Cause::Other,
    }
}

/// Setting of a camera.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Control {
    /// Name in the library.
    pub name: &'static str,
    /// Value in force.
    pub value: String,
    /// Labels of the choices; empty for settings of another kind.
    pub choices: Vec<String>,
    /// Whether the value can only be read.
    pub read_only: bool,
}

/// A file on the camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraFile {
    /// Folder.
    pub folder: String,
    /// Name.
    pub name: String,
}

/// Memory card or other storage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage {
    /// Whether it can be written.
    pub writable: bool,
    /// Free space in KiB, if known.
    pub free_kib: Option<u64>,
}

/// A camera of the library, or a fake one in tests.
pub trait Node: Send {
    /// Model, as the library names it.
    fn model(&mut self) -> String;
    /// A setting; `None` if the camera lacks it.
    fn control(&mut self, name: &'static str) -> NodeResult<Option<Control>>;
    /// Sets a value by its label.
    fn set(&mut self, name: &'static str, value: &str) -> NodeResult<()>;
    /// Takes a photograph; returns its file.
    fn capture(&mut self) -> NodeResult<CameraFile>;
    /// Content of a file of at most `limit` bytes.
    fn fetch(&mut self, file: &CameraFile, limit: u64) -> NodeResult<Vec<u8>>;
    /// Deletes a file.
    fn delete(&mut self, file: &CameraFile) -> NodeResult<()>;
    /// Memory cards; empty if there is none.
    fn storages(&mut self) -> NodeResult<Vec<Storage>>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_the_library_have_causes() {
        for (code, message, expected) in [
            (-3, "Camera memorycard ran full during capture.", Cause::CardFull),
            (-1, "Canon EOS Capture failed to release: Perhaps no more memory on card?", Cause::CardFull),
            (-1, "Canon EOS Capture failed to release: Card read-only?", Cause::CardProtected),
            (-1, "Canon EOS Capture failed to release: Perhaps mirror up?", Cause::Mirror),
            (-1, "Canon EOS Capture failed to release: Perhaps no focus?", Cause::Focus),
            (-1, "Fuji Capture failed: Perhaps no auto-focus?", Cause::Focus),
            (-1, "Out of Focus", Cause::Focus),
            (-1, "Low Battery", Cause::Battery),
            (-1, "Lens Cover Closed", Cause::Lens),
            (-1, "PTP Store Not Available", Cause::NoCard),
            (-1, "Shutter Speed Bulb", Cause::Bulb),
            (-53, "", Cause::Held),
            (-52, "", Cause::Gone),
            (-115, "", Cause::CardFull),
            (-1, "PTP General Error", Cause::Other),
        ] {
            assert_eq!(cause(code, message), expected, "{message}");
        }
    }
}
