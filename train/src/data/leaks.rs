//! Objects of joined sets: what one set holds out, another must not train on.

use super::unfit;
use crate::TrainError;
use formats::Split;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// An object of a set and what it is for there.
#[derive(Clone, Debug)]
pub(super) struct Named {
    /// Tells objects apart over several sets where their meshes do not.
    pub(super) name: String,
    /// Digest of its mesh file; empty where its shard does not say.
    pub(super) mesh: String,
    pub(super) split: Split,
    pub(super) set: PathBuf,
}

impl Named {
    /// Whether both are one object: made from one mesh, whatever their names; of one name, where not both say what they were made
    /// from.
    fn is(&self, other: &Named) -> bool {
        match self.mesh.is_empty() || other.mesh.is_empty() {
            true => self.name == other.name,
            false => self.mesh == other.mesh,
        }
    }
}

/// Objects are split, never samples: what one set holds out, another must not train on.
///
/// # Errors
/// The first object of which that is not so.
pub(super) fn check(objects: &[Named]) -> Result<(), TrainError> {
    const WAY_OUT: &str = "make the sets with the same objects, seed and validation_share (all three decide which objects are held \
                           out), or from different objects";
    let mut trained = BTreeMap::<&str, Vec<&Named>>::new();
    for object in objects.iter().filter(|o| o.split == Split::Train) {
        for key in [&object.name, &object.mesh].into_iter().filter(|key| !key.is_empty()) {
            trained.entry(key).or_default().push(object);
        }
    }
    let held = objects.iter().filter(|o| o.split != Split::Train);
    let leaks: Vec<(&Named, &Named)> = held.filter_map(|held| Some((held, elsewhere(held, &trained)?))).collect();
    let Some((held, there)) = leaks.first() else { return Ok(()) };
    let problem = format!(
        "{} is for {} here and for training{} in {:?} ({} such objects)",
        held.name,
        if held.split == Split::Test { "test" } else { "validation" },
        if there.name == held.name { String::new() } else { format!(" as {}", there.name) },
        there.set,
        leaks.len()
    );
    Err(unfit(&held.set, problem, WAY_OUT))
}

/// The object that is trained on in another set. Copies of a mesh that a set has on both sides itself are in it however it is
/// joined.
fn elsewhere<'a>(held: &Named, trained: &BTreeMap<&str, Vec<&'a Named>>) -> Option<&'a Named> {
    let keys = [held.name.as_str(), held.mesh.as_str()];
    let same = keys.into_iter().filter_map(|key| trained.get(key)).flatten().copied().filter(|other| held.is(other));
    let same: Vec<&Named> = same.collect();
    if same.iter().any(|other| other.set == held.set) { None } else { same.first().copied() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn object(set: &str, name: &str, mesh: &str, split: Split) -> Named {
        Named { name: name.into(), mesh: mesh.into(), split, set: set.into() }
    }

    #[test]
    fn objects_are_told_apart_by_mesh_and_where_that_is_unknown_by_name() {
        let held = object("one", "part2", "aa", Split::Validation);
        let said = |other: Named| check(&[held.clone(), other]).map_err(|error| error.to_string());
        let trained = |name: &str, mesh: &str| object("other", name, mesh, Split::Train);
        assert_eq!(said(trained("part2", "bb")), Ok(()), "another mesh of this name");
        assert_eq!(said(trained("part3", "")), Ok(()));
        assert_eq!(said(object("other", "part2", "aa", Split::Validation)), Ok(()), "held out by both");
        for mesh in ["aa", ""] {
            let text = said(trained("part2", mesh)).expect_err("the same");
            assert!(text.contains("part2 is for validation here and for training in \"other\" (1 such"), "{text}");
            assert!(text.contains("the same objects, seed and validation_share"), "{text}");
        }
        let text = said(trained("copy", "aa")).expect_err("the same mesh");
        assert!(text.contains("for training as copy in \"other\""), "{text}");
    }

    #[test]
    fn copies_within_a_set_do_not_keep_it_from_being_joined() {
        let set = |set: &str| [object(set, "a", "aa", Split::Train), object(set, "copy of a", "aa", Split::Validation)];
        assert!(check(&[set("one"), set("other")].concat()).is_ok());
        let mixed = [set("one").to_vec(), vec![object("other", "a", "aa", Split::Validation)]].concat();
        assert!(check(&mixed).is_err(), "held out by the other, which does not train on it");
    }
}
