//! A fingerprint of a JSON text, computed while reading, whatever its size: SHA-256, which is the same in every program that reads it
//! again and has no collisions to be found.

use serde::de::{Deserialize, DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use sha2::{Digest, Sha256};
use std::fmt;

/// The same for JSON that differs in spaces alone; of missing JSON as of `null`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fingerprint([u8; 32]);

impl Fingerprint {
    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

impl Default for Fingerprint {
    fn default() -> Self {
        Self(Sha256::digest([0u8]).into())
    }
}

impl<'de> Deserialize<'de> for Fingerprint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut sum = Sha256::new();
        Walk(&mut sum).deserialize(deserializer)?;
        Ok(Self(sum.finalize().into()))
    }
}

/// Adds each value as a byte that says what it is, and its bytes: of text with their number first, of the others as many as it has.
struct Walk<'a>(&'a mut Sha256);

impl Walk<'_> {
    fn add<E>(self, kind: u8, value: &[u8]) -> Result<(), E> {
        self.0.update([kind]);
        self.0.update(value);
        Ok(())
    }
}

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        self.add(0, &[])
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.add(1, &[u8::from(value)])
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.add(2, &value.to_le_bytes())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.add(3, &value.to_le_bytes())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.add(4, &value.to_le_bytes())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<(), E> {
        self.0.update([5u8]);
        self.0.update((value.len() as u64).to_le_bytes());
        self.0.update(value);
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        self.0.update([6u8]);
        while list.next_element_seed(Walk(self.0))?.is_some() {}
        self.add(7, &[])
    }

    fn visit_map<A: MapAccess<'de>>(self, mut object: A) -> Result<(), A::Error> {
        self.0.update([8u8]);
        while object.next_key_seed(Walk(self.0))?.is_some() {
            object.next_value_seed(Walk(self.0))?;
        }
        self.add(9, &[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_json_has_another_fingerprint() {
        let of = |text: &str| serde_json::from_str::<Fingerprint>(text).expect("JSON");
        assert_eq!(of(r#"{"a":[1,2.5,"x"]}"#), of(r#" { "a" : [ 1, 2.5, "x" ] } "#), "spaces say nothing");
        assert_eq!(of("null"), Fingerprint::default());
        let different =
            [r#"{"a":1}"#, r#"{"a":"1"}"#, r#"{"a":1.0}"#, r#"["a",1]"#, "[[1],2]", "[1,[2]]", "[]", "{}", "0", "null"];
        for (i, a) in different.iter().enumerate() {
            assert!(different[..i].iter().all(|b| of(a) != of(b)), "{a}");
        }
    }
}
