//! Every kind of open-loop steering of a scenario as a function of manoeuvre time.

use crate::curve::Curve;
use crate::random::RandomSines;
use crate::shape::{
    Motion, blended_ramp, blended_ramp_s, enveloped_sine, half_cosine, pulse, sine_with_dwell,
};
use crate::{HandWheel, ManoeuvreError, history};
use config::RecordedHistory;
use config::scenario::{Scenario, Steer};

/// Corners of a sine's amplitude, in periods.
const CORNERS: usize = 4;

/// One steering input, prepared. Angles in rad, times in manoeuvre time.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Steering {
    Hold(f64),
    Free,
    Path,
    Sine {
        start_s: f64,
        frequency_hz: f64,
        corners: [(f64, f64); CORNERS],
        count: usize,
    },
    Dwell {
        start_s: f64,
        amplitude: f64,
        frequency_hz: f64,
        dwell_s: f64,
    },
    Step {
        start_s: f64,
        angle: f64,
        rise_s: f64,
        hold_s: Option<f64>,
    },
    /// Ramps one after the other: begin, from, to.
    Ramps {
        rate: f64,
        blend_s: f64,
        parts: Vec<(f64, f64, f64)>,
        ends: bool,
    },
    Random {
        start_s: f64,
        end_s: f64,
        fade_s: f64,
        sines: RandomSines,
    },
    Table(Curve),
    Recorded {
        curve: Curve,
        fade_in_s: f64,
    },
}

impl Steering {
    pub(crate) fn new(scenario: &Scenario, record: Option<&RecordedHistory>) -> Result<Self, ManoeuvreError> {
        Ok(match &scenario.steer {
            Steer::Hold { angle_deg } => Self::Hold(angle_deg.to_radians()),
            Steer::Free {} => Self::Free,
            Steer::Path(_) => Self::Path,
            Steer::Sine(sine) => Self::sine(
                sine.start_s,
                sine.frequency_hz,
                sine.amplitude_deg.to_radians(),
                [sine.fade_in_cycles, sine.cycles, sine.fade_out_cycles],
            ),
            Steer::Weave(weave) => Self::sine(
                weave.start_s,
                weave.frequency_hz,
                weave.amplitude_deg.to_radians(),
                [1.0, f64::from(weave.cycles), 1.0],
            ),
            Steer::LaneChange(change) => Self::sine(
                change.start_s,
                change.frequency_hz,
                change.amplitude_deg.to_radians(),
                [0.0, 1.0, 0.0],
            ),
            Steer::GrowingSine(sine) => {
                let first = (0.0, sine.first_amplitude_deg.to_radians());
                let grown = (sine.cycles, sine.last_amplitude_deg.to_radians());
                let end = (sine.cycles + sine.fade_out_cycles, 0.0);
                let count = if sine.fade_out_cycles > 0.0 { 3 } else { 2 };
                let corners = [first, grown, end, end];
                Self::Sine { start_s: sine.start_s, frequency_hz: sine.frequency_hz, corners, count }
            }
            Steer::SineWithDwell(sine) => Self::Dwell {
                start_s: sine.start_s,
                amplitude: sine.amplitude_deg.to_radians(),
                frequency_hz: sine.frequency_hz,
                dwell_s: sine.dwell_s,
            },
            Steer::Step(step) => Self::Step {
                start_s: step.start_s,
                angle: step.angle_deg.to_radians(),
                rise_s: step.rise_s,
                hold_s: step.hold_s,
            },
            Steer::Ramp(ramp) => {
                let (rate, angle) = (ramp.rate_deg_s.to_radians(), ramp.angle_deg.to_radians());
                let mut parts = vec![(ramp.start_s, 0.0, angle)];
                if let Some(hold_s) = ramp.hold_s {
                    let up_s = blended_ramp_s(angle, rate, ramp.blend_s);
                    parts.push((ramp.start_s + up_s + hold_s, angle, 0.0));
                }
                Self::Ramps { rate, blend_s: ramp.blend_s, parts, ends: ramp.hold_s.is_some() }
            }
            Steer::Parking(parking) => {
                let (rate, angle) = (parking.rate_deg_s.to_radians(), parking.angle_deg.to_radians());
                let sides = (0..parking.cycles).flat_map(|_| [angle, -angle]).chain([0.0]);
                let (mut begin_s, mut from) = (parking.start_s, 0.0);
                let parts = sides
                    .map(|to| {
                        let part = (begin_s, from, to);
                        begin_s += blended_ramp_s(to - from, rate, parking.blend_s) + parking.pause_s;
                        from = to;
                        part
                    })
                    .collect();
                Self::Ramps { rate, blend_s: parking.blend_s, parts, ends: true }
            }
            Steer::Random(random) => {
                let rms = random.rms_deg.to_radians();
                let band = &random.band;
                let sines =
                    RandomSines::new(scenario.seed, random.components, band.low_hz, band.high_hz, rms);
                Self::Random { start_s: random.start_s, end_s: random.end_s, fade_s: random.fade_s, sines }
            }
            Steer::Table(table) => {
                let angles = table.angle_deg.iter().map(|angle| angle.to_radians()).collect();
                Self::Table(Curve::new(table.time_s.clone(), angles))
            }
            Steer::RecordedHistory(recorded) => {
                let series = record.and_then(|record| record.steering_wheel_angle_rad.as_ref());
                let curve = series.and_then(|series| history::curve(series, recorded.low_pass_hz));
                Self::Recorded {
                    curve: curve.ok_or(ManoeuvreError::SteeringRecordMissing)?,
                    fade_in_s: scenario.record.as_ref().map_or(0.0, |record| record.fade_in_s),
                }
            }
        })
    }

    /// `cycles`: rising, full, falling. Corners without length are left out.
    fn sine(start_s: f64, frequency_hz: f64, amplitude: f64, cycles: [f64; 3]) -> Self {
        let [rising, full, falling] = cycles;
        let mut corners = [(0.0, 0.0); CORNERS];
        let mut count = 0;
        let mut add = |period: f64, amplitude: f64| {
            corners[count] = (period, amplitude);
            count += 1;
        };
        if rising > 0.0 {
            add(0.0, 0.0);
        }
        add(rising, amplitude);
        add(rising + full, amplitude);
        if falling > 0.0 {
            add(rising + full + falling, 0.0);
        }
        Self::Sine { start_s, frequency_hz, corners, count }
    }

    pub(crate) fn hand_wheel(&self) -> HandWheel {
        match self {
            Self::Free => HandWheel::Free,
            Self::Path => HandWheel::PathDriver,
            _ => HandWheel::Commanded,
        }
    }

    /// Angle and rate at manoeuvre time `tau`. Inputs that do not start from straight ahead are led in
    /// over the warm-up.
    pub(crate) fn at(&self, tau: f64, warm_up_s: f64) -> Motion {
        let lead_in = || half_cosine(tau + warm_up_s, warm_up_s);
        match self {
            Self::Hold(angle) => lead_in().scaled(*angle),
            Self::Free | Self::Path => Motion::default(),
            Self::Sine { start_s, frequency_hz, corners, count } => {
                enveloped_sine(tau - start_s, *frequency_hz, &corners[..*count])
            }
            Self::Dwell { start_s, amplitude, frequency_hz, dwell_s } => {
                sine_with_dwell(tau - start_s, *frequency_hz, *dwell_s).scaled(*amplitude)
            }
            Self::Step { start_s, angle, rise_s, hold_s } => match hold_s {
                None => half_cosine(tau - start_s, *rise_s).scaled(*angle),
                Some(hold_s) => pulse(tau, *start_s, start_s + 2.0 * rise_s + hold_s, *rise_s).scaled(*angle),
            },
            Self::Ramps { rate, blend_s, parts, .. } => {
                let Some((begin_s, from, to)) = parts.iter().rev().find(|(begin_s, ..)| tau >= *begin_s)
                else {
                    return Motion::default();
                };
                let along = blended_ramp(tau - begin_s, to - from, *rate, *blend_s);
                Motion { value: from + along.value, rate: along.rate }
            }
            Self::Random { start_s, end_s, fade_s, sines } => {
                let window = pulse(tau, *start_s, *end_s, *fade_s);
                if window.value == 0.0 { Motion::default() } else { sines.at(tau - start_s).times(window) }
            }
            Self::Table(curve) => curve.at(tau).times(lead_in()),
            Self::Recorded { curve, fade_in_s } => curve.at(tau).times(half_cosine(tau, *fade_in_s)),
        }
    }

    /// Begin and end of the steering, in manoeuvre time.
    pub(crate) fn window(&self) -> (f64, f64) {
        match self {
            Self::Hold(_) | Self::Free | Self::Path => (0.0, f64::INFINITY),
            Self::Sine { start_s, frequency_hz, corners, count } => {
                (*start_s, start_s + corners[count - 1].0 / frequency_hz)
            }
            Self::Dwell { start_s, frequency_hz, dwell_s, .. } => {
                (*start_s, start_s + 1.0 / frequency_hz + dwell_s)
            }
            Self::Step { start_s, rise_s, hold_s, .. } => {
                (*start_s, hold_s.map_or(f64::INFINITY, |hold_s| start_s + 2.0 * rise_s + hold_s))
            }
            Self::Ramps { rate, blend_s, parts, ends } => {
                let end = parts
                    .last()
                    .map_or(0.0, |(begin_s, from, to)| begin_s + blended_ramp_s(to - from, *rate, *blend_s));
                (parts.first().map_or(0.0, |part| part.0), if *ends { end } else { f64::INFINITY })
            }
            Self::Random { start_s, end_s, .. } => (*start_s, *end_s),
            Self::Table(curve) => (0.0, curve.end()),
            Self::Recorded { curve, .. } => (0.0, curve.end()),
        }
    }

    pub(crate) fn active(&self, tau: f64) -> bool {
        let (start, end) = self.window();
        (start..end).contains(&tau)
    }
}
