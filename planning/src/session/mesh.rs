//! The surface of the accumulated cloud as triangles.

use super::{Session, SessionError};
use crate::{Budget, Stopped};
use geometry::reconstruction::reconstruct_while;
use geometry::{Reconstruction, reconstruct};

impl Session {
    /// The surface of that cloud as triangles: closed where it was measured all around, else with a rim where it ends.
    pub fn mesh(&self) -> Reconstruction {
        reconstruct(&self.state.cloud, self.state.grid_size)
    }

    /// The same within a budget.
    ///
    /// # Errors
    /// It takes longer, or nobody waits for it.
    pub fn mesh_within(&self, budget: &Budget) -> Result<Reconstruction, SessionError> {
        let made = reconstruct_while(&self.state.cloud, self.state.grid_size, || !budget.is_spent());
        match made {
            Some(made) => Ok(made),
            None => Err(budget.allows(false).err().unwrap_or(Stopped::Late).into()),
        }
    }
}
