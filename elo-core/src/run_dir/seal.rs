//! The footer that tells a whole and right file from a damaged, shortened or misplaced one.
//!
//! A sealed file is the payload followed by 84 bytes: what it is (8 bytes), the number of the format (`u32`), the
//! length of the payload (`u64`), the key (32 bytes) and the BLAKE3 hash of everything before (32 bytes); integers
//! are little-endian.

use crate::key::Key;

const FORMAT: u32 = 1;
const HASH: usize = 32;
const FOOTER: usize = 8 + 4 + 8 + 32 + HASH;

/// What a sealed file holds; a file of one kind is never taken for the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Unit,
    Checkpoint,
}

impl Content {
    fn magic(self) -> &'static [u8; 8] {
        match self {
            Self::Unit => b"elo unit",
            Self::Checkpoint => b"elo ckpt",
        }
    }
}

/// The file for `payload`.
pub(super) fn seal(content: Content, key: &Key, payload: &[u8]) -> Vec<u8> {
    let mut file = Vec::with_capacity(payload.len() + FOOTER);
    file.extend_from_slice(payload);
    file.extend_from_slice(content.magic());
    file.extend_from_slice(&FORMAT.to_le_bytes());
    file.extend_from_slice(&(payload.len() as u64).to_le_bytes());
    file.extend_from_slice(key.as_bytes());
    let hash = blake3::hash(&file);
    file.extend_from_slice(hash.as_bytes());
    file
}

/// The payload of `file`, or what is wrong with it in a few words.
pub(super) fn unseal(content: Content, key: &Key, mut file: Vec<u8>) -> Result<Vec<u8>, &'static str> {
    let length = file.len().checked_sub(FOOTER).ok_or("shorter than its footer")?;
    let (before, hash) = file.split_at(file.len() - HASH);
    if blake3::hash(before).as_bytes() != hash {
        return Err("its hash does not fit its bytes");
    }
    let (magic, rest) = before[length..].split_at(8);
    let (format, rest) = rest.split_at(4);
    let (stated, of) = rest.split_at(8);
    if format != FORMAT.to_le_bytes() {
        return Err("written in another format");
    }
    if magic != content.magic() {
        return Err("of another kind than its place");
    }
    if stated != (length as u64).to_le_bytes() {
        return Err("its length is not the one stated");
    }
    if of != key.as_bytes() {
        return Err("it belongs to another key");
    }
    file.truncate(length);
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::key::Stage;
    use crate::seed::Seed;

    fn key(index: u64) -> Key {
        Key::of(&Stage { name: "test", version: 1 }, &(), &[], &Seed::root(index), "")
    }

    #[test]
    fn only_the_file_that_was_sealed_is_opened() {
        let file = seal(Content::Unit, &key(1), b"payload");
        assert_eq!(file.len(), 7 + FOOTER);
        assert_eq!(unseal(Content::Unit, &key(1), file.clone()), Ok(b"payload".to_vec()));
        assert_eq!(unseal(Content::Unit, &key(2), file.clone()), Err("it belongs to another key"));
        assert_eq!(unseal(Content::Checkpoint, &key(1), file), Err("of another kind than its place"));
    }

    #[test]
    fn a_longer_payload_under_the_same_hash_is_refused() {
        // A whole file of another payload length, resealed by hand: only the stated length is wrong.
        let mut file = seal(Content::Unit, &key(1), b"payload");
        file.truncate(file.len() - HASH);
        file.insert(0, b'x');
        let hash = blake3::hash(&file);
        file.extend_from_slice(hash.as_bytes());
        assert_eq!(unseal(Content::Unit, &key(1), file), Err("its length is not the one stated"));
    }

    #[test]
    fn another_format_is_refused() {
        let mut file = seal(Content::Unit, &key(1), b"");
        file.truncate(file.len() - HASH);
        file[8] = 2;
        let hash = blake3::hash(&file);
        file.extend_from_slice(hash.as_bytes());
        assert_eq!(unseal(Content::Unit, &key(1), file), Err("written in another format"));
    }
}
