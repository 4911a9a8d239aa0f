//! `monitor`: the essentials of a running bench in a terminal, for ssh. Reads the table, read-only.

use crate::exit::Exit;
use crate::output;
use clap::Args;
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Borders, Paragraph, Row, Sparkline, Table};
use regions::{
    Bench as BenchRegion, LoggerStatus, Payload, RegionId, RigMeasurement, RigStatus, Timing, VehicleState,
};
use safety::TripCode;
use std::collections::VecDeque;
use std::time::Duration;
use table::{Bench, RegionReader};

/// Time between two looks.
const LOOK: Duration = Duration::from_millis(100);
/// Looks a curve keeps.
const KEPT: usize = 600;

/// Arguments of `monitor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Keys: q or Esc leaves. Shown: state and trip, steering, forces, speed, timing of each service [µs], restarts, the \
logger's backlog.

Examples:
  kingpin monitor
  kingpin monitor --once            print one look and leave, for scripts")]
pub struct MonitorArgs {
    /// Name of the bench
    #[arg(long, default_value = "bench", value_name = "NAME")]
    pub name: String,
    /// Print one look as text and leave
    #[arg(long)]
    pub once: bool,
}

/// One look at the table.
struct Look {
    bench: BenchRegion,
    measured: RigMeasurement,
    car: VehicleState,
    status: RigStatus,
    timing: [Timing; 3],
    logger: LoggerStatus,
}

struct Eyes {
    readers: Vec<(RegionId, RegionReader)>,
}

impl Eyes {
    fn open(bench: &Bench) -> Result<Self, String> {
        let wanted = [
            RegionId::Bench,
            RegionId::RigMeasurement,
            RegionId::VehicleState,
            RegionId::RigStatus,
            RegionId::RigTiming,
            RegionId::VehicleTiming,
            RegionId::MultibodyTiming,
            RegionId::LoggerStatus,
        ];
        let readers = wanted.map(|id| {
            let region = id.region();
            let reader = RegionReader::open_any(bench, region.name).map_err(|e| e.to_string())?;
            if reader.layout().hash == region.layout.hash() {
                Ok((id, reader))
            } else {
                Err(format!("region {} is another version's", region.name))
            }
        });
        Ok(Eyes { readers: readers.into_iter().collect::<Result<_, String>>()? })
    }

    fn latest<P: Payload>(&self, id: RegionId) -> P {
        let mut payload = P::absent();
        if let Some((_, reader)) = self.readers.iter().find(|(known, _)| *known == id) {
            reader.latest(reader.head(), payload.words_mut());
        }
        payload
    }

    fn look(&self) -> Look {
        Look {
            bench: self.latest(RegionId::Bench),
            measured: self.latest(RegionId::RigMeasurement),
            car: self.latest(RegionId::VehicleState),
            status: self.latest(RegionId::RigStatus),
            timing: [
                self.latest(RegionId::RigTiming),
                self.latest(RegionId::VehicleTiming),
                self.latest(RegionId::MultibodyTiming),
            ],
            logger: self.latest(RegionId::LoggerStatus),
        }
    }
}

/// `kingpin monitor`.
pub fn monitor(args: &MonitorArgs) -> Exit {
    let bench = match Bench::new(&args.name) {
        Ok(bench) => bench,
        Err(error) => {
            output::note(error);
            return Exit::BadInput;
        }
    };
    let eyes = match Eyes::open(&bench) {
        Ok(eyes) => eyes,
        Err(error) => {
            output::note(error);
            return Exit::Unavailable;
        }
    };
    if args.once {
        for (name, value) in essentials(&eyes.look()) {
            output::line(format!("{name:<28}{value}"));
        }
        return Exit::Done;
    }
    let mut terminal = match ratatui::try_init() {
        Ok(terminal) => terminal,
        Err(error) => {
            output::note(format!("no terminal to draw on: {error}; try --once"));
            return Exit::Unavailable;
        }
    };
    let done = watch(&mut terminal, &eyes, &args.name);
    ratatui::restore();
    match done {
        Ok(()) => Exit::Done,
        Err(error) => {
            output::note(error);
            Exit::Failed
        }
    }
}

/// Curves under the figures.
#[derive(Default)]
struct Curves {
    lateness_us: VecDeque<u64>,
    force_n: VecDeque<u64>,
}

fn watch(terminal: &mut ratatui::DefaultTerminal, eyes: &Eyes, name: &str) -> std::io::Result<()> {
    let mut curves = Curves::default();
    loop {
        let look = eyes.look();
        let push = |curve: &mut VecDeque<u64>, value: f64| {
            if curve.len() == KEPT {
                curve.pop_front();
            }
            curve.push_back(if value.is_finite() { value.abs() as u64 } else { 0 });
        };
        push(&mut curves.lateness_us, look.timing[0].wake_lateness_s * 1e6);
        push(&mut curves.force_n, look.measured.tie_rod_force_n[0]);
        terminal.draw(|frame| draw(frame, &look, &curves, name))?;
        if event::poll(LOOK)?
            && let Event::Key(key) = event::read()?
            && (matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)
                || (key.code == KeyCode::Char('c') && key.modifiers.contains(event::KeyModifiers::CONTROL)))
        {
            return Ok(());
        }
    }
}

fn trip(status: &RigStatus) -> String {
    let code = u8::try_from(status.trip_code).ok().and_then(TripCode::from_number);
    match code {
        Some(code) => {
            let (what, unit) = code.describe();
            format!(
                "{what}: {:.4} {unit}, limit {:.4} {unit}, tick {}",
                status.trip_value, status.trip_limit, status.trip_tick
            )
        }
        None if status.trip_code != 0 => format!("code {}", status.trip_code),
        None => "none".to_owned(),
    }
}

/// What matters, by name.
fn essentials(look: &Look) -> Vec<(&'static str, String)> {
    let (m, car, status) = (&look.measured, &look.car, &look.status);
    let speed = 3.6 * car.velocity_m_s[0];
    vec![
        ("state", regions::state_name(status.state).to_owned()),
        ("time [s]", format!("{:.2}", m.time_s)),
        ("trip", trip(status)),
        ("emergency stop", (if look.bench.emergency_stop == 1 { "PRESSED" } else { "released" }).to_owned()),
        ("steering angle [deg]", format!("{:+.1}", m.steering_wheel_angle_rad.to_degrees())),
        ("steering torque [N·m]", format!("{:+.2}", m.steering_wheel_torque_n_m)),
        ("rack [mm]", format!("{:+.2}", 1e3 * m.rack_displacement_m)),
        ("tie rods [N]", format!("{:+.0}  {:+.0}", m.tie_rod_force_n[0], m.tie_rod_force_n[1])),
        ("speed [km/h]", format!("{speed:.1} of {:.1}", 3.6 * car.target_speed_m_s)),
        ("lateral accel. [m/s²]", format!("{:+.2}", car.acceleration_m_s2[1])),
        ("force fade", format!("{:.2}", status.force_fade_ratio)),
        ("commands late", status.late_command_count.to_string()),
        ("energy at tie rods [J]", format!("{:.1}", status.port_energy_j)),
        ("parameters version", status.parameters_version.to_string()),
        ("log behind [ticks]", m.tick.saturating_sub(look.logger.read_tick).to_string()),
        ("log lost [ticks]", look.logger.lost_count.to_string()),
    ]
}

fn colour(state: u64) -> Color {
    match regions::state_name(state) {
        "running" => Color::Green,
        "tripped" => Color::Red,
        "off" | "idle" => Color::Gray,
        _ => Color::Yellow,
    }
}

fn draw(frame: &mut Frame, look: &Look, curves: &Curves, name: &str) {
    let areas: [Rect; 4] = Layout::vertical([
        Constraint::Length(3),
        Constraint::Min(18),
        Constraint::Length(7),
        Constraint::Length(6),
    ])
    .areas(frame.area());
    let style = Style::default().fg(Color::Black).bg(colour(look.status.state)).add_modifier(Modifier::BOLD);
    let head = Line::from(vec![
        Span::styled(format!("  {}  ", regions::state_name(look.status.state).to_uppercase()), style),
        Span::raw(format!("  bench {name}   {:.1} s   q leaves", look.measured.time_s)),
    ]);
    frame.render_widget(
        Paragraph::new(head).block(Block::new().borders(Borders::ALL).title(" kingpin ")),
        areas[0],
    );
    let lines: Vec<_> = essentials(look)
        .into_iter()
        .map(|(what, value)| {
            let bad = (what == "trip" && value != "none") || value == "PRESSED";
            let style = if bad { Style::default().fg(Color::Red).bold() } else { Style::default() };
            Line::from(vec![Span::raw(format!(" {what:<26}")), Span::styled(value, style)])
        })
        .collect();
    frame.render_widget(Paragraph::new(lines).block(Block::new().borders(Borders::ALL)), areas[1]);
    let us =
        |seconds: f64| if seconds.is_finite() { format!("{:.0}", 1e6 * seconds) } else { "-".to_owned() };
    let rows =
        ["rig", "vehicle", "multibody"].iter().zip(&look.timing).enumerate().map(|(i, (service, t))| {
            let alive = if look.bench.alive[i] == 1 { "yes" } else { "NO" };
            Row::new([
                (*service).to_owned(),
                alive.to_owned(),
                us(t.wake_lateness_s),
                us(t.compute_s),
                us(t.done_s),
                t.late_wake_count.to_string(),
                t.overrun_count.to_string(),
                t.missed_count.to_string(),
                look.bench.restarts[i].to_string(),
            ])
        });
    let heads =
        ["service", "alive", "late µs", "takes µs", "done µs", "late", "overruns", "missed", "restarts"];
    let table = Table::new(rows, [Constraint::Ratio(1, 9); 9])
        .header(Row::new(heads).style(Style::default().bold()))
        .block(Block::new().borders(Borders::ALL).title(" timing "));
    frame.render_widget(table, areas[2]);
    let halves: [Rect; 2] = Layout::horizontal([Constraint::Ratio(1, 2); 2]).areas(areas[3]);
    let curve = |title: &'static str, data: &VecDeque<u64>, area: Rect, frame: &mut Frame| {
        let width = usize::from(area.width.saturating_sub(2));
        let shown: Vec<u64> = data.iter().skip(data.len().saturating_sub(width)).copied().collect();
        let block = Block::new().borders(Borders::ALL).title(title);
        frame.render_widget(Sparkline::default().block(block).data(&shown), area);
    };
    curve(" rig wake-up lateness [µs] ", &curves.lateness_us, halves[0], frame);
    curve(" tie-rod force left, magnitude [N] ", &curves.force_n, halves[1], frame);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    #[test]
    fn the_essentials_are_on_the_screen() {
        let mut look = Look {
            bench: BenchRegion::absent(),
            measured: RigMeasurement::absent(),
            car: VehicleState::absent(),
            status: RigStatus::absent(),
            timing: [Timing::absent(); 3],
            logger: LoggerStatus::absent(),
        };
        (look.status.state, look.status.trip_code, look.status.trip_tick) = (8, 10, 4711);
        (look.status.trip_value, look.status.trip_limit) = (9600.0, 9500.0);
        look.measured.tie_rod_force_n = [1234.0, -777.0];
        look.timing[1].compute_s = 42e-6;
        let mut terminal = Terminal::new(TestBackend::new(110, 40)).unwrap();
        terminal.draw(|frame| draw(frame, &look, &Curves::default(), "test")).unwrap();
        let screen: String = terminal.backend().buffer().content().iter().map(|cell| cell.symbol()).collect();
        for expected in [
            "TRIPPED",
            "tie-rod force: 9600.0000 N, limit 9500.0000 N, tick 4711",
            "+1234  -777",
            "42",
            "vehicle",
        ] {
            assert!(screen.contains(expected), "{expected} is not in\n{screen}");
        }
    }
}
