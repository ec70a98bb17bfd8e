//! Why a transform cannot be had.

/// Why a transform cannot be had.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransformError {
    /// No transform names it.
    #[error("frame {frame:?} is not in the tree of transforms ({known})")]
    Unknown {
        /// The frame.
        frame: String,
        /// Those that are.
        known: String,
    },
    /// Two trees.
    #[error(
        "no transforms connect {frame:?} (in the tree of {root:?}) with {base:?} (in the tree of {base_root:?}): one between the \
         trees is missing"
    )]
    Unconnected {
        /// The frame.
        frame: String,
        /// The root of its tree.
        root: String,
        /// The other.
        base: String,
        /// The root of that tree.
        base_root: String,
    },
    /// The newest is older than what is asked for.
    #[error("the newest transform of {child:?} in {parent:?} is {by_s:.3} s older than the message")]
    TooNew {
        /// The frame.
        child: String,
        /// What it stands in.
        parent: String,
        /// Seconds.
        by_s: f64,
    },
    /// The oldest is newer than what is asked for.
    #[error(
        "the message is {by_s:.3} s older than the oldest transform kept of {child:?} in {parent:?} ({kept_s:.0} s are: ros2.tf_kept_s)"
    )]
    TooOld {
        /// The frame.
        child: String,
        /// What it stands in.
        parent: String,
        /// Seconds.
        by_s: f64,
        /// Seconds that are kept.
        kept_s: f64,
    },
    /// A frame that stands in itself by way of others.
    #[error("the transforms form a cycle at {frame:?}")]
    Circle {
        /// One of them.
        frame: String,
    },
}

impl TransformError {
    /// Whether waiting may help: what is missing may still be on its way.
    pub fn may_come(&self) -> bool {
        !matches!(self, Self::TooOld { .. } | Self::Circle { .. })
    }
}
