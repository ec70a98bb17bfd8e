//! Settings in layers: defaults in code, then a TOML file, then `--set key=value`, then flags. An unknown key
//! or a wrong type is an error that names the layer it came from.

use crate::checksum;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Why the settings of a run cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The configuration file cannot be read.
    #[error("cannot read configuration {path:?}: {cause}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// A layer holds an unknown key, a wrong type or no TOML.
    #[error("{origin}: {message}")]
    Layer {
        /// Where the setting came from: a file, `--set "a.b=1"`, or a flag.
        origin: String,
        /// What is wrong, with the key and what was expected.
        message: String,
    },
    /// The settings of a run are not those that it was started with.
    #[error(transparent)]
    Stored(#[from] crate::FormatError),
    /// The settings cannot be written as TOML.
    #[error("settings cannot be written as TOML: {0}")]
    Serialize(#[from] toml::ser::Error),
}

/// What is wrong with the text of a `--set`.
#[derive(Debug, thiserror::Error)]
enum SetError {
    #[error("expected key=value, e.g. camera.width=640")]
    NoValue,
    #[error("{0:?} is not a key; expected names joined by dots, e.g. camera.width")]
    Key(String),
    #[error("{0}")]
    Value(String),
}

/// An invalid setting.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} = {found}: expected {expected}")]
pub struct SettingError {
    /// Its dotted key.
    pub key: &'static str,
    /// Its value.
    pub found: String,
    /// What would do.
    pub expected: &'static str,
}

impl SettingError {
    /// Of this key.
    pub fn new(key: &'static str, found: impl ToString, expected: &'static str) -> Self {
        Self { key, found: found.to_string(), expected }
    }
}

/// A command-line flag that stands for a setting.
#[derive(Clone, Debug)]
pub struct Flag {
    /// As the user writes it, e.g. `--scans`.
    pub name: &'static str,
    /// The setting's dotted key, e.g. `episode.scans`.
    pub key: &'static str,
    /// Its value.
    pub value: Value,
}

impl Flag {
    /// The flag as a layer if it was given, e.g. `Flag::given("--scans", "episode.scans", args.scans)`.
    pub fn given(name: &'static str, key: &'static str, value: Option<impl Into<Value>>) -> Option<Flag> {
        value.map(|v| Flag { name, key, value: v.into() })
    }
}

/// The settings of a run. `T` uses `#[serde(default, deny_unknown_fields)]` and nested tables (no `flatten`);
/// `set` holds the values of `--set` as typed (`key=value`; the value is read as TOML, and as a string where
/// it is no TOML, so that `--set dataset.name=folder` needs no quotes).
///
/// ```
/// use serde::{Deserialize, Serialize};
///
/// #[derive(Debug, Default, Serialize, Deserialize)]
/// #[serde(default, deny_unknown_fields)]
/// struct Settings {
///     seed: u64,
/// }
///
/// let settings: Settings = formats::config::load(None, &["seed=7".to_owned()], &[])?;
/// assert_eq!(settings.seed, 7);
/// # Ok::<(), formats::ConfigError>(())
/// ```
///
/// # Errors
/// An unreadable file; an unknown key or a wrong type, named with the layer it came from.
pub fn load<T>(file: Option<&Path>, set: &[String], flags: &[Flag]) -> Result<T, ConfigError>
where
    T: Serialize + DeserializeOwned + Default,
{
    let mut table = Table::try_from(T::default())?;
    if let Some(path) = file {
        let text =
            std::fs::read_to_string(path).map_err(|source| ConfigError::Io { path: path.to_owned(), cause: source })?;
        let blame = |e: toml::de::Error| layer_error(format!("{path:?}"), &e);
        // Once as T for a message with line and column, once as a table to merge.
        toml::from_str::<T>(&text).map_err(blame)?;
        merge(&mut table, text.parse::<Table>().map_err(blame)?);
    }
    for text in set {
        let origin = format!("--set {text:?}");
        let layer =
            parse_set(text).map_err(|e| ConfigError::Layer { origin: origin.clone(), message: e.to_string() })?;
        apply::<T>(&mut table, layer, origin)?;
    }
    for flag in flags {
        let leaf = flag.value.clone();
        let layer =
            flag.key.rsplit('.').fold(leaf, |inner, key| Value::Table(Table::from_iter([(key.to_owned(), inner)])));
        let Value::Table(layer) = layer else { continue };
        apply::<T>(&mut table, layer, format!("{} {}", flag.name, flag.value))?;
    }
    Value::Table(table).try_into().map_err(|e| layer_error("settings".to_owned(), &e))
}

/// Settings with changes laid over them: JSON with tables for tables, or null for one that is optional. `name` is what they are called
/// in errors.
///
/// # Errors
/// An unknown key or a wrong type, by name.
pub fn overlaid<T>(base: &T, changes: serde_json::Value, name: &str) -> Result<T, String>
where
    T: Serialize + DeserializeOwned,
{
    let mut merged = serde_json::to_value(base).map_err(|e| format!("{name}: {e}"))?;
    let mut removed = Vec::new();
    merge_json(&mut merged, changes, name, &mut removed)?;
    serde_json::from_value(merged).map_err(|e| match &removed[..] {
        [] => format!("{name}: {e}"),
        // The reason does not say which.
        removed => format!("{name}: {e} (null was given for {})", removed.join(", ")),
    })
}

/// Lays changes over `base`, which is known as `name`; what is an object there is one here, or null, and named in `removed`.
fn merge_json(
    base: &mut serde_json::Value,
    changes: serde_json::Value,
    name: &str,
    removed: &mut Vec<String>,
) -> Result<(), String> {
    use serde_json::Value;
    match (base, changes) {
        (Value::Object(base), Value::Object(changes)) => changes.into_iter().try_for_each(|(key, value)| {
            let name = format!("{name}.{key}");
            merge_json(base.entry(key).or_insert(Value::Null), value, &name, removed)
        }),
        (Value::Object(_), changes) if !changes.is_null() => Err(format!("{name}: expected an object of settings")),
        (base, changes) => {
            if base.is_object() {
                removed.push(name.to_owned());
            }
            *base = changes;
            Ok(())
        }
    }
}

/// The settings as the text of a TOML file.
///
/// # Errors
/// A type that TOML cannot say.
pub fn to_toml<T: Serialize>(config: &T) -> Result<String, ConfigError> {
    // By way of a table, so that plain values come before nested tables whatever the order of the fields.
    Ok(toml::to_string_pretty(&Table::try_from(config)?)?)
}

/// What stands before the digits of the checksum in the settings of a run.
const CHECKSUM: &[u8] = b"\n# sha256 = \"";

/// The settings of a run as its directory keeps them: [`to_toml`] with a checksum at its end.
///
/// # Errors
/// As [`to_toml`].
pub fn to_stored<T: Serialize>(config: &T) -> Result<Vec<u8>, ConfigError> {
    let mut text = to_toml(config)?;
    text.push_str("\n# Of this file; to change a setting, give --set or a changed copy as --config.");
    text.push_str(&String::from_utf8_lossy(CHECKSUM));
    text.push_str(checksum::UNKNOWN);
    text.push_str("\"\n");
    let mut bytes = text.into_bytes();
    checksum::seal(&mut bytes, CHECKSUM);
    Ok(bytes)
}

/// Holds the settings that a run's directory keeps against their checksum; older programs wrote none.
///
/// # Errors
/// A file that cannot be read, was damaged, or edited.
pub fn check_stored(path: &Path) -> Result<(), ConfigError> {
    let bytes = std::fs::read(path).map_err(|cause| ConfigError::Io { path: path.to_owned(), cause })?;
    if !bytes.windows(CHECKSUM.len()).any(|window| window == CHECKSUM) {
        tracing::warn!("{path:?} has no checksum: an older program wrote it; damage would go unnoticed");
        return Ok(());
    }
    const WAY_OUT: &str =
        "it was edited or damaged; restore the original file, and change settings with flags or --set";
    Ok(checksum::check(path, &bytes, CHECKSUM, WAY_OUT)?)
}

/// First 16 hexadecimal digits of the SHA-256 of the settings' TOML text.
///
/// # Errors
/// A type that TOML cannot say.
pub fn hash<T: Serialize>(config: &T) -> Result<String, ConfigError> {
    Ok(digest(to_toml(config)?.as_bytes()))
}

/// First 16 hexadecimal digits of the SHA-256 of these bytes.
pub fn digest(bytes: &[u8]) -> String {
    checksum::sha256(bytes)[..16].to_owned()
}

/// Settings that had another name once, in any program.
const RENAMED: [(&str, &str); 3] =
    [("rate", "learning_rate"), ("min_rate", "min_learning_rate"), ("never", "views_if_unreached")];

fn layer_error(origin: String, error: &toml::de::Error) -> ConfigError {
    let mut message = error.to_string().trim_end().replace('\n', "\n  ");
    let renamed = RENAMED.iter().find(|(old, _)| message.contains(&format!("unknown field `{old}`")));
    if let Some((old, new)) = renamed.filter(|(_, new)| message.contains(&format!("`{new}`"))) {
        message += &format!("\n  `{old}` is called `{new}` now");
    }
    ConfigError::Layer { origin, message }
}

/// Merges one layer and checks at once, so that the error names the layer.
fn apply<T: DeserializeOwned>(table: &mut Table, layer: Table, origin: String) -> Result<(), ConfigError> {
    merge(table, layer);
    Value::Table(table.clone()).try_into::<T>().map(drop).map_err(|e| layer_error(origin, &e))
}

/// Values of `layer` replace those of `table`; tables are merged key by key, arrays replaced whole.
fn merge(table: &mut Table, layer: Table) {
    for (key, value) in layer {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => merge(old, new),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

fn parse_set(text: &str) -> Result<Table, SetError> {
    let Some((key, value)) = text.split_once('=') else {
        return Err(SetError::NoValue);
    };
    let (key, value) = (key.trim(), value.trim());
    let is_key =
        |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
    if !key.split('.').all(is_key) {
        return Err(SetError::Key(key.to_owned()));
    }
    format!("{key} = {value}")
        .parse()
        .or_else(|_| format!("{key} = {}", Value::from(value)).parse())
        .map_err(|e: toml::de::Error| SetError::Value(e.message().to_owned()))
}

#[cfg(test)]
mod tests;
