//! A fingerprint of a JSON text, computed while reading, whatever its size.

use serde::de::{Deserialize, DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};

/// The same for JSON that differs in spaces alone; of missing JSON as of `null`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Fingerprint(u64);

impl Default for Fingerprint {
    fn default() -> Self {
        let mut hasher = DefaultHasher::new();
        0u8.hash(&mut hasher);
        Self(hasher.finish())
    }
}

impl<'de> Deserialize<'de> for Fingerprint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut hasher = DefaultHasher::new();
        Walk(&mut hasher).deserialize(deserializer)?;
        Ok(Self(hasher.finish()))
    }
}

struct Walk<'a>(&'a mut DefaultHasher);

impl Walk<'_> {
    fn add<E>(self, kind: u8, value: impl Hash) -> Result<(), E> {
        (kind, value).hash(self.0);
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
        0u8.hash(self.0);
        Ok(())
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.add(1, value)
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.add(2, value)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.add(3, value)
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.add(4, value.to_bits())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<(), E> {
        self.add(5, value)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        6u8.hash(self.0);
        while list.next_element_seed(Walk(self.0))?.is_some() {}
        self.add(7, ())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut object: A) -> Result<(), A::Error> {
        8u8.hash(self.0);
        while object.next_key_seed(Walk(self.0))?.is_some() {
            object.next_value_seed(Walk(self.0))?;
        }
        self.add(9, ())
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
            [r#"{"a":1}"#, r#"{"a":"1"}"#, r#"{"a":1.0}"#, r#"["a",1]"#, "[[1],2]", "[1,[2]]", "[]", "{}", "0"];
        for (i, a) in different.iter().enumerate() {
            assert!(different[..i].iter().all(|b| of(a) != of(b)), "{a}");
        }
    }
}
