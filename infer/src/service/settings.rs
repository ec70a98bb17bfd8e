//! JSON from strangers, bounded before it becomes a tree: seven bytes of text may be hundreds of a tree.

use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};
use std::cell::Cell;
use std::fmt;

/// Values in a tree at most: room for every list of settings at its longest.
const NODES: usize = 60_000;

/// Any JSON of at most [`NODES`] values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundedJson(pub Value);

impl<'de> Deserialize<'de> for BoundedJson {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let left = Cell::new(NODES);
        Node { left: &left }.deserialize(deserializer).map(Self)
    }
}

#[derive(Clone, Copy)]
struct Node<'a> {
    left: &'a Cell<usize>,
}

impl Node<'_> {
    fn count<E: Error>(self) -> Result<(), E> {
        let left = self.left.get().checked_sub(1);
        self.left.set(left.ok_or_else(|| E::custom(format!("more than {NODES} values")))?);
        Ok(())
    }
}

impl<'de> DeserializeSeed<'de> for Node<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Node<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        self.count().map(|()| Value::Null)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        self.count().map(|()| value.into())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        self.count().map(|()| value.into())
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        self.count().map(|()| value.into())
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        self.count().map(|()| value.into())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        self.count().map(|()| value.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Value, A::Error> {
        self.count()?;
        let mut values = Vec::new();
        while let Some(value) = list.next_element_seed(self)? {
            values.push(value);
        }
        Ok(Value::Array(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut object: A) -> Result<Value, A::Error> {
        self.count()?;
        let mut values = Map::new();
        while let Some(key) = object.next_key::<String>()? {
            let value = object.next_value_seed(self)?;
            if values.contains_key(&key) {
                return Err(A::Error::custom(format!("{key:?} is given twice")));
            }
            values.insert(key, value);
        }
        Ok(Value::Object(values))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trees_are_as_written_or_refused() {
        let text = r#"{"a": [1, -2, 3.5, null, true, "x"], "b": {"c": {}}}"#;
        let read: BoundedJson = serde_json::from_str(text).expect("JSON");
        assert_eq!(read.0, serde_json::from_str::<Value>(text).expect("JSON"));
        let bomb = format!(r#"{{"x":[{}0]}}"#, r#"{"":0},"#.repeat(NODES));
        let error = serde_json::from_str::<BoundedJson>(&bomb).expect_err("a bomb").to_string();
        assert!(error.contains("more than 60000 values at line 1 column"), "{error}");
        assert!(serde_json::from_str::<BoundedJson>(&"[".repeat(100_000)).is_err(), "depth is bounded as well");
        let twice = serde_json::from_str::<BoundedJson>(r#"{"a": 1, "a": 2}"#).expect_err("which?").to_string();
        assert!(twice.contains("\"a\" is given twice"), "{twice}");
    }
}
