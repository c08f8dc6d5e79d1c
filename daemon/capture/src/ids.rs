//! Identifiers of sessions, results and calibrations: ULIDs, which sort by their time.

use std::sync::{Mutex, PoisonError};
use ulid::Generator;

/// Length of an identifier in characters.
const LENGTH: usize = 26;

/// Identifiers of the same millisecond increase, too.
static IDS: Mutex<Generator> = Mutex::new(Generator::new());

/// A new identifier; later ones sort after earlier ones.
pub fn new_id() -> String {
    let mut ids = IDS.lock().unwrap_or_else(PoisonError::into_inner);
    ids.generate().unwrap_or_else(|overflow| overflow.commit_overflow_increment()).to_string()
}

/// True for a text with the form of an identifier, which therefore cannot name any other path.
pub fn is_id(text: &str) -> bool {
    text.len() == LENGTH && text.bytes().all(|b| b.is_ascii_digit() || b.is_ascii_uppercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_one_millisecond_are_in_order() {
        let ids: Vec<String> = (0..1000).map(|_| new_id()).collect();
        assert!(ids.windows(2).all(|pair| pair[0] < pair[1]) && ids.iter().all(|id| is_id(id)));
        assert!(["", "..", "01ARZ3NDEKTSV4RRFFQ69G5FA/", "01arz3ndektsv4rrffq69g5fav"].iter().all(|id| !is_id(id)));
    }
}
