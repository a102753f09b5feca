//! The name of a unit of work: a hash of everything that its result depends on, and of nothing else.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use serde_json::Value;

use crate::seed::Seed;

/// Keeps these hashes apart from every other use of BLAKE3. Changing the encoding means changing this text.
const CONTEXT: &str = "early-life options, key of a unit of work, encoding 1";

/// A kind of unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Stage {
    /// Its name, e.g. `teacher`.
    pub name: &'static str,
    /// To be raised with every change of code after which the same inputs give other bytes.
    pub version: u32,
}

/// The 256-bit key of a unit, written as 64 lowercase hexadecimal digits.
///
/// Equal keys mean equal results: a stored unit is used again for whatever has its key. Worker counts, paths and the
/// parameters of other stages are therefore kept out of it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key([u8; 32]);

impl Key {
    /// The key of the unit that `stage` makes of `inputs`, in their order, with its own `params`.
    ///
    /// `fingerprint` names the program and the engine that compute it, with their versions. Objects in `params` count
    /// by their fields, in whatever order these are listed. JSON has no NaN and no infinity: they count as null, so
    /// parameters must have been validated as finite before.
    ///
    /// # Panics
    /// When `params` has no form as JSON, e.g. a map whose keys are structs: a mistake in its type.
    pub fn of(
        stage: &Stage,
        params: &impl Serialize,
        inputs: &[Self],
        seed: &Seed,
        fingerprint: &str,
    ) -> Self {
        let mut hasher = blake3::Hasher::new_derive_key(CONTEXT);
        let mut part = |bytes: &[u8]| {
            hasher.update(&(bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        part(stage.name.as_bytes());
        part(&stage.version.to_le_bytes());
        part(canonical_json(params).as_bytes());
        part(inputs.iter().flat_map(|key| key.0).collect::<Vec<u8>>().as_slice());
        part(canonical_json(seed).as_bytes());
        part(fingerprint.as_bytes());
        Self(*hasher.finalize().as_bytes())
    }

    /// The hash itself.
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }
}

/// `value` as JSON without spaces and with the fields of every object in the order of their names.
fn canonical_json(value: &impl Serialize) -> String {
    let value = serde_json::to_value(value).expect("parameters are plain data");
    let mut text = String::new();
    write_canonical(&value, &mut text);
    text
}

fn write_canonical(value: &Value, text: &mut String) {
    match value {
        Value::Array(items) => {
            text.push('[');
            for (i, item) in items.iter().enumerate() {
                if i > 0 {
                    text.push(',');
                }
                write_canonical(item, text);
            }
            text.push(']');
        }
        Value::Object(fields) => {
            // Whether serde_json's own map is sorted depends on features that any crate of a program can turn on.
            let mut fields: Vec<_> = fields.iter().collect();
            fields.sort_by_key(|(name, _)| *name);
            text.push('{');
            for (i, (name, field)) in fields.into_iter().enumerate() {
                if i > 0 {
                    text.push(',');
                }
                text.push_str(&Value::from(name.as_str()).to_string());
                text.push(':');
                write_canonical(field, text);
            }
            text.push('}');
        }
        scalar => text.push_str(&scalar.to_string()),
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({self})")
    }
}

/// A text that is not 64 lowercase hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a key: expected 64 lowercase hexadecimal digits")]
pub struct NotAKey(String);

impl FromStr for Key {
    type Err = NotAKey;

    fn from_str(text: &str) -> Result<Self, NotAKey> {
        let digit = |c: u8| match c {
            b'0'..=b'9' => Some(c - b'0'),
            b'a'..=b'f' => Some(c - b'a' + 10),
            _ => None,
        };
        let mut bytes = [0; 32];
        let (pairs, rest) = text.as_bytes().as_chunks::<2>();
        let read = (pairs.len() == bytes.len() && rest.is_empty()).then_some(()).and_then(|()| {
            for (byte, pair) in bytes.iter_mut().zip(pairs) {
                *byte = digit(pair[0])? << 4 | digit(pair[1])?;
            }
            Some(Self(bytes))
        });
        read.ok_or_else(|| NotAKey(text.to_owned()))
    }
}

impl Serialize for Key {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use serde_json::json;

    const STAGE: Stage = Stage { name: "teacher", version: 1 };

    fn key(stage: Stage, params: Value, inputs: &[Key], seed: &Seed, fingerprint: &str) -> Key {
        Key::of(&stage, &params, inputs, seed, fingerprint)
    }

    #[test]
    fn every_component_changes_the_key_and_no_two_meet() {
        let seed = Seed::root(1);
        let a = key(STAGE, json!({}), &[], &seed, "a");
        let b = key(STAGE, json!({}), &[], &seed, "b");
        let keys = [
            key(STAGE, json!({"k": 5}), &[a, b], &seed, "elo 1"),
            key(Stage { version: 2, ..STAGE }, json!({"k": 5}), &[a, b], &seed, "elo 1"),
            key(Stage { name: "teache", ..STAGE }, json!({"k": 5}), &[a, b], &seed, "elo 1"),
            key(STAGE, json!({"k": 6}), &[a, b], &seed, "elo 1"),
            key(STAGE, json!({"k": 5.0}), &[a, b], &seed, "elo 1"),
            key(STAGE, json!({"k": "5"}), &[a, b], &seed, "elo 1"),
            key(STAGE, json!({"k": [5]}), &[a, b], &seed, "elo 1"),
            key(STAGE, json!({"k": 5}), &[b, a], &seed, "elo 1"),
            key(STAGE, json!({"k": 5}), &[a], &seed, "elo 1"),
            key(STAGE, json!({"k": 5}), &[], &seed, "elo 1"),
            key(STAGE, json!({"k": 5}), &[a, b], &seed.index(0), "elo 1"),
            key(STAGE, json!({"k": 5}), &[a, b], &Seed::root(2), "elo 1"),
            key(STAGE, json!({"k": 5}), &[a, b], &seed, "elo 1 mujoco 3.17.0"),
            a,
            b,
        ];
        for (i, left) in keys.iter().enumerate() {
            assert!(keys[i + 1..].iter().all(|right| left != right), "key {i}: {keys:?}");
        }
    }

    #[test]
    fn what_moves_from_one_component_to_the_next_changes_the_key() {
        let seed = Seed::root(1);
        let left = key(Stage { name: "a", version: 1 }, json!("b"), &[], &seed, "c");
        assert_ne!(left, key(Stage { name: "a\"b", version: 1 }, json!(""), &[], &seed, "c"));
        // The seed path ends in what the fingerprint begins with.
        assert_ne!(
            key(STAGE, json!(0), &[], &Seed::root(12), "3"),
            key(STAGE, json!(0), &[], &Seed::root(1), "23")
        );
    }

    #[test]
    fn order_of_fields_does_not_count_at_any_depth_and_order_of_items_does() {
        #[derive(Serialize)]
        struct Forward {
            a: u8,
            b: XThenY,
        }
        #[derive(Serialize)]
        struct XThenY {
            x: f64,
            y: f64,
        }
        #[derive(Serialize)]
        struct Backward {
            b: YThenX,
            a: u8,
        }
        #[derive(Serialize)]
        struct YThenX {
            y: f64,
            x: f64,
        }
        let text = r#"{"a":1,"b":{"x":0.5,"y":2.0}}"#;
        assert_eq!(canonical_json(&Forward { a: 1, b: XThenY { x: 0.5, y: 2.0 } }), text);
        assert_eq!(canonical_json(&Backward { b: YThenX { y: 2.0, x: 0.5 }, a: 1 }), text);
        assert_eq!(canonical_json(&json!({"\"": [2, 1, null]})), r#"{"\"":[2,1,null]}"#);
    }

    #[test]
    fn keys_are_pinned_across_versions_and_machines() {
        let key = Key::of(&STAGE, &json!({"steps": 100}), &[], &Seed::root(1).child("teachers"), "elo 1");
        assert_eq!(key.to_string(), "9131abaec5b7038bb3d64b20179d8c43da2040df0593bc4f73a0225bb4395756");
    }

    #[test]
    fn text_and_json_give_the_key_back_and_refuse_everything_else() {
        let key = Key::of(&STAGE, &(), &[], &Seed::root(1), "");
        let text = key.to_string();
        assert_eq!(text.parse(), Ok(key));
        assert_eq!(serde_json::from_str::<Key>(&serde_json::to_string(&key).unwrap()).unwrap(), key);
        let wrong = [&text[1..], &format!("{text}0"), &text.replace(&text[..1], "g"), "", &"A".repeat(64)];
        for text in wrong {
            assert_eq!(text.parse::<Key>(), Err(NotAKey(text.to_owned())));
        }
    }
}
