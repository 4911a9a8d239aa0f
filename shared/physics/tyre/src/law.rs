//! Where forces come from: the Magic Formula or tables, behind one set of calls.

use crate::formula::{Forced, Formula, Outcome, Slip};
use crate::table::TableLaw;
use crate::turn_slip::Spin;

/// Source of forces.
#[derive(Debug, Clone)]
pub(crate) enum Law {
    Magic(Box<Formula>),
    Table(Box<TableLaw>),
}

impl Law {
    /// Longitudinal slip stiffness. [N]
    #[inline]
    pub fn kxk(&self, fz: f64, dpi: f64) -> f64 {
        match self {
            Self::Magic(f) => f.kxk(fz, dpi),
            Self::Table(t) => t.kxk(fz),
        }
    }

    /// Cornering stiffness. [N/rad]
    #[inline]
    pub fn kya(&self, fz: f64, dpi: f64, gamma_star: f64) -> f64 {
        match self {
            Self::Magic(f) => f.kya(fz, dpi, gamma_star, 1.0),
            Self::Table(t) => t.kya(fz),
        }
    }

    #[inline]
    pub fn forces(&self, s: &Slip, spin: Option<&Spin>) -> Forced {
        match self {
            Self::Magic(f) => f.forces(s, spin),
            Self::Table(t) => t.forces(s),
        }
    }

    #[inline]
    pub fn moments(
        &self,
        s: &Slip,
        spin: Option<&Spin>,
        forced: &Forced,
        fx: f64,
        fy: f64,
        my: f64,
    ) -> Outcome {
        match self {
            Self::Magic(f) => f.moments(s, spin, forced, fx, fy, my),
            Self::Table(t) => t.moments(s, forced, fx, fy, my),
        }
    }

    #[inline]
    pub fn my(&self, s: &Slip, fx: f64) -> f64 {
        match self {
            Self::Magic(f) => f.my(s, fx),
            Self::Table(t) => t.my(s),
        }
    }
}
