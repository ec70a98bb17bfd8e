//! Every reader on mutated files: no panic, and no allocation beyond what the file warrants. A second per
//! reader by default; `FUZZ_SECONDS=600 cargo test --release -p formats --test fuzz -- --nocapture` for longer.

mod arms;
mod cameras;
mod clouds;
mod depth;
mod harness;
mod meshes;
mod poses;
mod sets;
