//! Messages as ROS 2 lays them out: the same fields in the same order as in the `.msg` files of its packages (those since Humble).
#![allow(missing_docs, reason = "fields are explained in the .msg files")]

mod bytes;
mod common;
mod sensors;
mod visualization;

pub use bytes::ByteArray;
pub use common::*;
pub use sensors::*;
pub use visualization::*;
