//! Elementary functions of the formula.

/// Sign with sgn 0 = 0.
#[inline]
pub(crate) fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// cos(arctan x)
#[inline]
pub(crate) fn cos_of_atan(x: f64) -> f64 {
    1.0 / (1.0 + x * x).sqrt()
}

/// arctan x
#[inline]
pub(crate) fn atan(x: f64) -> f64 {
    x.atan()
}

/// sin x
#[inline]
pub(crate) fn sin(x: f64) -> f64 {
    x.sin()
}

/// cos x
#[inline]
pub(crate) fn cos(x: f64) -> f64 {
    x.cos()
}

/// tan x
#[inline]
pub(crate) fn tan(x: f64) -> f64 {
    x.tan()
}

/// e^x
#[inline]
pub(crate) fn exp(x: f64) -> f64 {
    x.exp()
}
