//! The names of policies on the command line, in configuration files and in journals: `family`, or `family:variant`.

use super::recorded::EVIDENCE;
use super::{Own, Radius};
use datagen::EpisodeEvidence;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Name, and what it is, of every policy.
pub const POLICIES: &[(&str, &str)] = &[
    ("benbv", "the paper's model-based search, 20 candidates; knows the object"),
    ("benbv:60", "the same with 20 targets x 3 angles (any multiple of 3, e.g. benbv:300)"),
    ("benbv:shifted", "reference: search averaged over sub-pixel shifts"),
    ("auto", "what `infer` does by default: the best planner for the inputs"),
    ("benbv-net", "the paper's network; no model of the object (benbv-net:DIR with the checkpoint in DIR)"),
    ("pc-nbv", "PC-NBV over its 33 views at the working distance (pc-nbv:paper: unmasked, 0.3 m farther)"),
    ("see", "SEE++ with parameters from the first scan"),
    ("see:r010", "SEE++ with r = 0.010, rho = 4e6"),
    ("see:paper", "SEE++ as the paper's benchmark called it"),
    ("random-boundary", "one of BENBV's candidates at random"),
    ("random-sphere", "random on a sphere at the working distance (random-sphere:paper: 0.3 m farther; :R metres)"),
    ("random-u-sphere", "latitude-longitude grid without repetition (:paper, :R as above)"),
    ("random-33", "PC-NBV's 33 views at random, without repetition (:paper, :R as above)"),
    ("volumetric", "carved voxels, expected surface, gain and overlap per view; 60 candidates, no model of the object"),
    (
        "volumetric:learned",
        "the same with learned gain and overlap, from --set weights.forecasts=FILE (:learned-gain, :learned-overlap)",
    ),
    ("farthest", "the view farthest in angle from all past cameras, of 500 on a sphere (:R in metres)"),
    ("farthest:60", "the same among BENBV's 60 candidates"),
    ("volumetric:true", "reference: volumetric with true gain and overlap (:true-gain, :true-overlap)"),
    ("volumetric:shifted", "reference: the same averaged over sub-pixel shifts (:shifted-gain, ...)"),
    ("oracle:20", "reference: greedy true gain among BENBV's 20 candidates (any multiple of 3 too)"),
    ("oracle:60", "reference: greedy true gain among 20 targets x 3 angles"),
    ("oracle:60:0.3", "reference: the same with an overlap of at least 0.3"),
    ("oracle:33", "reference: greedy true gain among PC-NBV's 33 views (oracle:33:paper: 0.3 m farther)"),
    ("oracle:sphere", "reference: greedy true gain among 500 views on a sphere"),
];

/// Those on recorded sequences (`--dataset sequences`).
pub const RECORDED_POLICIES: &[(&str, &str)] = &[
    ("oracle", "reference: greedy true gain among the remaining scans"),
    ("farthest", "largest least angle to all past cameras"),
    ("auto:depth-with-background", "what `infer` does, with depth images whose misses are free space"),
    ("auto:depth", "the same where misses mean nothing"),
    (
        "auto:camera-positions",
        "the same with clouds and their camera positions (auto: with the best evidence available)",
    ),
    ("auto:clouds", "the same with clouds alone (auto:merged: one cloud of all points)"),
    ("random", "any of the scans left"),
    ("recorded-order", "the scans in recorded order, starting over after the last"),
];

/// The paper's policies, as `--preset paper` runs them.
pub const PAPER_POLICIES: &[&str] = &[
    "benbv",
    "random-boundary",
    "random-sphere:paper",
    "random-u-sphere:paper",
    "see:paper",
    "pc-nbv:paper",
    "benbv-net",
];

/// A policy by its name: the name as it was written, so that journals and tables keep it, and what it says.
#[derive(Clone, Debug, PartialEq)]
pub struct Policy {
    name: String,
    kind: Kind,
}

/// What a name says.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// `benbv`: the search over as many candidates as configured, or this many.
    Search(Option<usize>),
    /// `benbv:shifted`.
    ShiftedSearch,
    /// `auto`.
    Auto,
    /// `auto` with this evidence from a recording.
    AutoOn(EpisodeEvidence),
    /// `random`: any scan of a recording.
    Random,
    /// `recorded-order`.
    RecordedOrder,
    /// `benbv-net`, with the weights in this directory instead of the configured ones.
    BenbvNet(Option<PathBuf>),
    /// `pc-nbv`, as published or not.
    PcNbv {
        /// Unmasked and farther.
        published: bool,
    },
    /// `see`.
    See(See),
    /// `random-boundary`.
    RandomBoundary,
    /// `random-sphere`.
    RandomSphere(Radius),
    /// `random-u-sphere`.
    RandomUSphere(Radius),
    /// `random-33`.
    Random33(Radius),
    /// `volumetric`, with forecasts replaced or not.
    Volumetric(Option<Refined>),
    /// `farthest`, on a sphere.
    FarthestOnSphere(Radius),
    /// `farthest`, among this many candidates.
    FarthestAmong(usize),
    /// A caller's own.
    Own(Own),
    /// `oracle`.
    Oracle {
        /// The views that it chooses among.
        among: Among,
        /// How far those on a sphere stand.
        radius: Radius,
        /// Least overlap.
        min_overlap: f64,
    },
}

/// Variants of `see`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum See {
    /// Parameters from the first scan.
    Configured,
    /// r = 0.010, rho = 4e6.
    Fixed,
    /// As the paper's benchmark called it.
    Paper,
}

/// What replaces the forecasts of `volumetric`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refined {
    /// Where the better ones come from.
    pub source: Source,
    /// Whether the gain is replaced.
    pub gain: bool,
    /// Whether the overlap is replaced.
    pub overlap: bool,
}

/// Where better forecasts come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The simulator.
    True,
    /// The simulator, as the mean of images shifted by quarter pixels.
    Shifted,
    /// A fit in the file of the settings.
    Learned,
}

/// What an oracle chooses among.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Among {
    /// This many candidates of BENBV.
    Candidates(usize),
    /// PC-NBV's 33 views.
    PcNbv33,
    /// A dense sphere.
    Sphere,
}

/// Why a name is none of a policy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// No policy of this name.
    #[error("no policy is named {name:?}{}; `evaluate --list-policies` lists them", meant(.suggestion))]
    Unknown {
        /// As given.
        name: String,
        /// A name much like it.
        suggestion: Option<String>,
    },
    /// A policy of ours has this name.
    #[error("{name:?} is already the name of a policy: choose another name")]
    Taken {
        /// As given.
        name: String,
    },
    /// A name that tables cannot show.
    #[error("{name:?} is not a valid policy name: expected 1 to 60 letters, digits, '-', '_', '.' and ':'")]
    Odd {
        /// As given.
        name: String,
    },
    /// The part after the colon makes no sense.
    #[error("{policy:?}: found the variant {variant:?}, expected {expected}")]
    Variant {
        /// As given.
        policy: String,
        /// The variant.
        variant: String,
        /// What would do.
        expected: &'static str,
    },
}

fn meant(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map_or_else(String::new, |name| format!(", did you mean {name:?}?"))
}

/// What a number of candidates must be.
pub(super) const COUNT: &str =
    "a number of candidates up to 10,000,000: 20, or a multiple of the number of angles, e.g. 60";
/// The most that a name may ask for, as `candidates.num_targets`: a mistyped number must not ask for all memory there is.
const MOST_CANDIDATES: usize = 10_000_000;
const MIN_OVERLAP: &str = "a set of views, then a minimum overlap from 0 to 1, e.g. 60:0.3";
const EVIDENCE_NAMES: &str =
    "nothing, or on recorded sequences depth-with-background, depth, camera-positions, clouds or merged";
const RADIUS: &str = "nothing, paper, or a radius in metres, e.g. 1.5";
const REFINED: &str = "nothing, true, shifted or learned, or one of these with -gain or -overlap";

impl Policy {
    /// A caller's own policy, by a name that no other has.
    ///
    /// # Errors
    /// The name of one of ours, or one that is none.
    pub fn own(name: &str, own: Own) -> Result<Self, NameError> {
        let odd = |c: char| !(c.is_alphanumeric() || "-_.:".contains(c));
        if name.is_empty() || name.chars().count() > 60 || name.contains(odd) {
            return Err(NameError::Odd { name: name.to_owned() });
        }
        match name.parse::<Self>() {
            Err(NameError::Unknown { .. }) => Ok(Self { name: name.to_owned(), kind: Kind::Own(own) }),
            _ => Err(NameError::Taken { name: name.to_owned() }),
        }
    }

    /// Whether a caller brought it along.
    pub fn is_own(&self) -> bool {
        matches!(self.kind, Kind::Own(_))
    }

    /// Whether nobody knows that it decides as it did before: a caller's own without a version.
    pub fn may_have_changed(&self) -> bool {
        matches!(&self.kind, Kind::Own(own) if own.version.is_none())
    }

    /// The name as it was written.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What the name says.
    pub fn kind(&self) -> &Kind {
        &self.kind
    }

    /// This policy's variant does not do.
    pub(super) fn unfit(&self, expected: &'static str) -> NameError {
        let variant = self.name.split_once(':').map_or("", |(_, v)| v).to_owned();
        NameError::Variant { policy: self.name.clone(), variant, expected }
    }
}

impl fmt::Display for Policy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl FromStr for Policy {
    type Err = NameError;

    fn from_str(name: &str) -> Result<Self, NameError> {
        let (family, variant) = name.split_once(':').map_or((name, None), |(f, v)| (f, Some(v)));
        let unfit = |expected| NameError::Variant {
            policy: name.to_owned(),
            variant: variant.unwrap_or_default().to_owned(),
            expected,
        };
        let on_sphere = || radius(variant).ok_or_else(|| unfit(RADIUS));
        let kind = match family {
            "benbv" => match variant {
                None => Kind::Search(None),
                Some("shifted") => Kind::ShiftedSearch,
                Some(v) => Kind::Search(Some(count(v).ok_or_else(|| unfit(COUNT))?)),
            },
            "auto" => match variant {
                None => Kind::Auto,
                Some(v) => match EVIDENCE.iter().find(|(name, _)| *name == v) {
                    Some((_, evidence)) => Kind::AutoOn(*evidence),
                    None => return Err(unfit(EVIDENCE_NAMES)),
                },
            },
            "random" | "recorded-order" if variant.is_some() => return Err(unfit("nothing")),
            "random" => Kind::Random,
            "recorded-order" => Kind::RecordedOrder,
            "benbv-net" => Kind::BenbvNet(variant.map(PathBuf::from)),
            "pc-nbv" => match variant {
                None => Kind::PcNbv { published: false },
                Some("paper") => Kind::PcNbv { published: true },
                Some(_) => return Err(unfit("nothing or paper")),
            },
            "see" => Kind::See(match variant {
                None => See::Configured,
                Some("r010") => See::Fixed,
                Some("paper") => See::Paper,
                Some(_) => return Err(unfit("nothing, r010 or paper")),
            }),
            "random-boundary" => match variant {
                None => Kind::RandomBoundary,
                Some(_) => return Err(unfit("nothing")),
            },
            "random-sphere" => Kind::RandomSphere(on_sphere()?),
            "random-u-sphere" => Kind::RandomUSphere(on_sphere()?),
            "random-33" => Kind::Random33(on_sphere()?),
            "volumetric" => Kind::Volumetric(match variant {
                None => None,
                Some(v) => Some(refined(v).ok_or_else(|| unfit(REFINED))?),
            }),
            "farthest" => match variant {
                Some(v) if v.parse::<u128>().is_ok() => Kind::FarthestAmong(count(v).ok_or_else(|| unfit(COUNT))?),
                _ => Kind::FarthestOnSphere(on_sphere()?),
            },
            "oracle" => {
                let text = variant.unwrap_or("60");
                let (set, rest) = text.split_once(':').map_or((text, None), |(s, r)| (s, Some(r)));
                let (radius, min_overlap) = match rest {
                    None => (Radius::Working, 0.0),
                    Some("paper") => (Radius::Paper, 0.0),
                    Some(r) => {
                        let least = r.parse().ok().filter(|r: &f64| (0.0..=1.0).contains(r));
                        (Radius::Working, least.ok_or_else(|| unfit(MIN_OVERLAP))?)
                    }
                };
                let among = match set {
                    "sphere" => Among::Sphere,
                    "33" => Among::PcNbv33,
                    number => Among::Candidates(count(number).ok_or_else(|| unfit(COUNT))?),
                };
                Kind::Oracle { among, radius, min_overlap }
            }
            _ => return Err(NameError::Unknown { name: name.to_owned(), suggestion: like(name) }),
        };
        Ok(Self { name: name.to_owned(), kind })
    }
}

/// A number of candidates, if it is one and not too large.
fn count(text: &str) -> Option<usize> {
    text.parse::<usize>().ok().filter(|count| *count <= MOST_CANDIDATES)
}

/// Distance of a sphere's cameras.
fn radius(variant: Option<&str>) -> Option<Radius> {
    match variant {
        None => Some(Radius::Working),
        Some("paper") => Some(Radius::Paper),
        Some(v) => v.parse().ok().filter(|r: &f64| *r > 0.0 && r.is_finite()).map(Radius::Fixed),
    }
}

/// `true`, `shifted` or `learned`, perhaps with `-gain` or `-overlap`.
fn refined(variant: &str) -> Option<Refined> {
    let (source, what) = variant.split_once('-').unwrap_or((variant, "gain-overlap"));
    let (gain, overlap) = match what {
        "gain" => (true, false),
        "overlap" => (false, true),
        "gain-overlap" => (true, true),
        _ => return None,
    };
    let source = match source {
        "true" => Source::True,
        "shifted" => Source::Shifted,
        "learned" => Source::Learned,
        _ => return None,
    };
    Some(Refined { source, gain, overlap })
}

/// The listed name or family that is written most like this one.
fn like(name: &str) -> Option<String> {
    let (family, rest) = name.find(':').map_or((name, ""), |i| name.split_at(i));
    let families =
        POLICIES.iter().chain(RECORDED_POLICIES).map(|(listed, _)| listed.split(':').next().unwrap_or(listed));
    let near = |listed: &str| strsim::damerau_levenshtein(family, listed);
    let nearest = families.min_by_key(|f| near(f))?;
    (near(nearest) <= 1 + family.len() / 4).then(|| format!("{nearest}{rest}"))
}

#[cfg(test)]
mod tests;
