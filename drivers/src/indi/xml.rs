//! The XML of INDI: a stream of elements without a common root, with attributes and text.
//!
//! The reader takes bytes as they arrive. Size and depth of an element are limited, since the other side may send
//! anything.

use std::collections::VecDeque;

/// Largest depth of elements.
const MAX_DEPTH: usize = 4;
/// Largest number of attributes of an element.
const MAX_ATTRIBUTES: usize = 32;
/// Largest number of elements within one.
const MAX_CHILDREN: usize = 1024;
/// Longest tag in bytes.
const MAX_TAG: usize = 8 * 1024;
/// Largest element in bytes, without pictures.
const MAX_ELEMENT: usize = 1024 * 1024;
/// Largest number of complete elements that wait to be read.
const MAX_WAITING: usize = 100_000;

/// An element.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Element {
    /// Name.
    pub name: String,
    /// Attributes.
    pub attributes: Vec<(String, String)>,
    /// Elements within this one.
    pub children: Vec<Element>,
    /// Text, with entities as received.
    pub text: Vec<u8>,
}

impl Element {
    /// Value of an attribute; empty if it is missing.
    pub fn get(&self, name: &str) -> &str {
        self.attributes.iter().find(|(key, _)| key == name).map_or("", |(_, value)| value)
    }

    /// Text without surrounding white space.
    pub fn trimmed(&self) -> String {
        unescaped(String::from_utf8_lossy(&self.text).trim())
    }
}

/// Reads elements from bytes.
#[derive(Debug, Default)]
pub struct Reader {
    /// Elements whose end has not arrived.
    open: Vec<Element>,
    complete: VecDeque<Element>,
    tag: Vec<u8>,
    within: Within,
    /// Bytes of the outermost open element.
    size: usize,
    picture_bytes: usize,
}

/// Position of the reader.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Within {
    #[default]
    Text,
    /// In a tag; the quote of an attribute that is open.
    Tag(Option<u8>),
}

impl Reader {
    /// Permits elements that are larger by this number of bytes, for pictures.
    pub fn permit(&mut self, picture_bytes: usize) {
        self.picture_bytes = picture_bytes;
    }

    /// The next complete element.
    pub fn next_element(&mut self) -> Option<Element> {
        self.complete.pop_front()
    }

    /// Adds received bytes.
    ///
    /// # Errors
    /// A description of the defect, after which the reader is unusable.
    pub fn push(&mut self, mut bytes: &[u8]) -> Result<(), String> {
        while !bytes.is_empty() {
            let taken = match self.within {
                Within::Text => self.push_text(bytes)?,
                Within::Tag(quote) => self.push_tag(bytes, quote)?,
            };
            bytes = bytes.get(taken..).unwrap_or_default();
        }
        Ok(())
    }

    fn grow(&mut self, by: usize) -> Result<(), String> {
        self.size += by;
        if self.size > MAX_ELEMENT.saturating_add(self.picture_bytes) {
            return Err(format!("an element of more than {} bytes", self.size - by));
        }
        Ok(())
    }

    /// Takes text up to the next tag; returns the number of bytes taken.
    fn push_text(&mut self, bytes: &[u8]) -> Result<usize, String> {
        let end = bytes.iter().position(|b| *b == b'<');
        let text = bytes.get(..end.unwrap_or(bytes.len())).unwrap_or_default();
        if !self.open.is_empty() {
            self.grow(text.len())?;
        }
        // Between elements there is only white space.
        if let Some(element) = self.open.last_mut() {
            element.text.extend_from_slice(text);
        }
        if end.is_some() {
            self.within = Within::Tag(None);
            self.tag.clear();
        }
        Ok(text.len() + usize::from(end.is_some()))
    }

    /// Takes bytes up to the end of a tag or quote; returns their number.
    fn push_tag(&mut self, bytes: &[u8], quote: Option<u8>) -> Result<usize, String> {
        let comment = self.tag.starts_with(b"!--");
        let stops = |b: u8| match quote {
            Some(quote) => b == quote,
            None => b == b'>' || (!comment && (b == b'"' || b == b'\'')),
        };
        let end = bytes.iter().position(|b| stops(*b));
        let taken = bytes.get(..end.map_or(bytes.len(), |end| end + 1)).unwrap_or_default();
        self.tag.extend_from_slice(taken);
        if self.tag.len() > MAX_TAG {
            return Err("a tag without an end".into());
        }
        match (end, taken.last(), quote) {
            (None, ..) => {}
            (_, _, Some(_)) => self.within = Within::Tag(None),
            (_, Some(b'>'), None) => {
                self.tag.pop();
                let tag = std::mem::take(&mut self.tag);
                if tag.starts_with(b"!--") && (tag.len() < 5 || !tag.ends_with(b"--")) {
                    // A comment may hold tags.
                    self.tag = tag;
                    self.tag.push(b'>');
                } else {
                    self.within = Within::Text;
                    self.end_of_tag(&tag)?;
                }
            }
            // Quotes in comments are text.
            _ if self.tag.starts_with(b"!--") => {}
            (_, quote, None) => self.within = Within::Tag(quote.copied()),
        }
        Ok(taken.len())
    }

    fn end_of_tag(&mut self, tag: &[u8]) -> Result<(), String> {
        let tag = String::from_utf8_lossy(tag);
        if tag.starts_with(['!', '?']) {
            return Ok(());
        }
        if let Some(name) = tag.strip_prefix('/') {
            let element = self.open.pop().filter(|element| element.name == name.trim());
            return self.close(element.ok_or_else(|| format!("the end of <{}> without its start", name.trim()))?);
        }
        if self.open.is_empty() {
            self.size = 0;
        }
        self.grow(tag.len())?;
        let (tag, empty) = tag.strip_suffix('/').map_or((&*tag, false), |tag| (tag, true));
        let element = start(tag)?;
        if empty {
            return self.close(element);
        }
        if self.open.len() >= MAX_DEPTH {
            return Err(format!("more than {MAX_DEPTH} elements within each other"));
        }
        self.open.push(element);
        Ok(())
    }

    fn close(&mut self, element: Element) -> Result<(), String> {
        match self.open.last_mut() {
            Some(parent) if parent.children.len() < MAX_CHILDREN => parent.children.push(element),
            Some(_) => return Err(format!("more than {MAX_CHILDREN} elements in one")),
            None if self.complete.len() < MAX_WAITING => self.complete.push_back(element),
            None => return Err("too many elements at once".into()),
        }
        Ok(())
    }
}

/// Reads name and attributes of a tag.
fn start(tag: &str) -> Result<Element, String> {
    let tag = tag.trim();
    let end = tag.find(char::is_whitespace).unwrap_or(tag.len());
    let (name, mut rest) = tag.split_at(end);
    if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || "_-.:".contains(c)) {
        return Err("a tag without a name".into());
    }
    let mut element = Element { name: name.to_owned(), ..Element::default() };
    loop {
        rest = rest.trim_start();
        if rest.is_empty() {
            return Ok(element);
        }
        let wrong = || format!("an attribute of <{name}> without a value");
        let (key, value) = rest.split_once('=').ok_or_else(wrong)?;
        let value = value.trim_start();
        let quote = value.chars().next().filter(|q| ['"', '\''].contains(q)).ok_or_else(wrong)?;
        let (value, after) = value.get(1..).and_then(|v| v.split_once(quote)).ok_or_else(wrong)?;
        if element.attributes.len() >= MAX_ATTRIBUTES {
            return Err(format!("more than {MAX_ATTRIBUTES} attributes"));
        }
        element.attributes.push((key.trim().to_owned(), unescaped(value)));
        rest = after;
    }
}

/// Replaces the five entities of XML and numbered characters.
fn unescaped(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some((before, after)) = rest.split_once('&') {
        out.push_str(before);
        let entity = after.split_once(';').filter(|(name, _)| name.len() <= 10);
        let known = entity.and_then(|(name, after)| Some((character(name)?, after)));
        match known {
            Some((c, after)) => {
                out.push(c);
                rest = after;
            }
            None => {
                out.push('&');
                rest = after;
            }
        }
    }
    out.push_str(rest);
    out
}

fn character(entity: &str) -> Option<char> {
    match entity {
        "lt" => Some('<'),
        "gt" => Some('>'),
        "amp" => Some('&'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        other => {
            let digits = other.strip_prefix('#')?;
            let code = match digits.strip_prefix('x') {
                Some(hex) => u32::from_str_radix(hex, 16).ok()?,
                None => digits.parse().ok()?,
            };
            char::from_u32(code)
        }
    }
}

/// Escapes a text for an attribute or the content of an element.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&apos;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Vec<Element>, String> {
        let mut reader = Reader::default();
        reader.push(text.as_bytes())?;
        Ok(std::iter::from_fn(|| reader.next_element()).collect())
    }

    const VECTOR: &str = "<?xml version='1.0'?>\n<setNumberVector device=\"R &amp; D > 1\" name='A'>\n  <oneNumber name=\"X\">\n1.5\n\
        </oneNumber><!-- it's a <tag> --></setNumberVector>\n<message message=\"it's\"/>";

    #[test]
    fn elements_have_attributes_children_and_text() {
        let elements = read(VECTOR).unwrap();
        assert_eq!(elements.len(), 2);
        assert_eq!((elements[0].get("device"), elements[0].get("name")), ("R & D > 1", "A"));
        assert_eq!(elements[0].children[0].trimmed(), "1.5");
        assert_eq!((elements[1].name.as_str(), elements[1].get("message")), ("message", "it's"));
        assert_eq!(elements[1].get("none"), "");
    }

    #[test]
    fn defects_are_named() {
        let deep = "<a>".repeat(5);
        let many = format!("<a>{}", "<b/>".repeat(1025));
        let wide = format!("<a{}>", " x='1'".repeat(33));
        for (text, word) in [
            ("</a>", "without its start"),
            ("<a></b>", "without its start"),
            ("<>", "without a name"),
            ("<a b>", "without a value"),
            ("<a b=c>", "without a value"),
            (&deep, "within each other"),
            (&many, "in one"),
            (&wide, "attributes"),
            (&format!("<a {}", "x".repeat(9000)), "without an end"),
            (&format!("<a>{}", "x".repeat(MAX_ELEMENT)), "more than"),
        ] {
            assert!(read(text).unwrap_err().contains(word), "{word}");
        }
    }

    #[test]
    fn pictures_may_be_larger() {
        let mut reader = Reader::default();
        reader.permit(1000);
        let text = format!("<a>{}</a>", "x".repeat(MAX_ELEMENT + 500));
        reader.push(text.as_bytes()).unwrap();
        assert_eq!(reader.next_element().unwrap().text.len(), MAX_ELEMENT + 500);
        assert!(reader.push(format!("<a>{}", "x".repeat(MAX_ELEMENT + 1001)).as_bytes()).is_err());
    }

    proptest! {
        #[test]
        fn pieces_give_the_same_elements(cuts in prop::collection::vec(1..40_usize, 0..12)) {
            let (mut reader, mut rest) = (Reader::default(), VECTOR.as_bytes());
            for cut in cuts {
                let (piece, after) = rest.split_at(cut.min(rest.len()));
                reader.push(piece).unwrap();
                rest = after;
            }
            reader.push(rest).unwrap();
            let pieces: Vec<Element> = std::iter::from_fn(|| reader.next_element()).collect();
            prop_assert_eq!(pieces, read(VECTOR).unwrap());
        }

        #[test]
        fn any_text_is_read_or_refused(text in "[<>/a='\"& !;#x-]{0,60}") {
            let _ = read(&text);
        }

        #[test]
        fn escaped_texts_come_back(text in "[ -~äµ]{0,30}") {
            let name = format!("<a b=\"{}\"/>", escaped(&text));
            let elements = read(&name).unwrap();
            prop_assert_eq!(elements[0].get("b"), text);
        }
    }
}
