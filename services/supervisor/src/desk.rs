//! The operator's desk: what an operator asked for, on top of what the plan asks, and the live parameters.
//!
//! The desk keeps the book of the parameters and publishes it whenever its version has changed. In a run that
//! runs by itself an operator may stop it, press the emergency stop and tune. In an operated run arming,
//! starting, stopping and acknowledging are the operator's too; the manoeuvre's clock starts with the start.

use crate::live;
use assembly::plan::{RunPlan, request};
use config::ResolvedBench;
use operator_link::{Answer, Entry, Operation, Request, Server};
use params::{Book, Fixed, LIST, Refusal, Schedule, Setting, Values};
use regions::{Bench, NO_TICK, Parameters, Payload, RegionId, state_name};
use runtime::clock::{Nanos, SECOND};
use table::{RegionWriter, Table};

/// A human's steering that is not repeated for this long is given back to the manoeuvre. [ns]
const STEER_MAX_NS: Nanos = SECOND / 2;

/// What operators asked for.
pub(crate) struct Desk {
    server: Option<Server>,
    writer: RegionWriter,
    book: Book,
    published: u64,
    schedule: Vec<(u64, Values)>,
    base: Values,
    operated: bool,
    ticks: u64,
    request: Option<u64>,
    request_count: u64,
    emergency_stop: bool,
    manoeuvre_start: u64,
    steered_at: Option<Nanos>,
    steering: bool,
}

impl Desk {
    /// Claims the parameters and opens the link; goes on where a supervisor that died had left off.
    pub(crate) fn new(
        table: &Table,
        bench: &table::Bench,
        resolved: &ResolvedBench,
        operated: bool,
        note: &mut dyn FnMut(&str),
    ) -> Result<Self, crate::RunError> {
        let schedule = Schedule::new(resolved).map_err(crate::RunError::Parameters)?;
        let writer = table.claim_writer(RegionId::Parameters as usize).map_err(crate::RunError::Table)?;
        let (_, base) = schedule.at(0);
        let mut last = Parameters::absent();
        let resumed = writer.reader().latest(writer.head(), last.words_mut()).is_some();
        let book = if resumed {
            Book::resume(params::defaults(resolved), last.value, last.version)
        } else {
            Book::resume(params::defaults(resolved), *base, 1)
        }
        .with_fixed(Fixed::on(resolved));
        let mut before = Bench::absent();
        let reader = table.reader(RegionId::Bench as usize);
        let (manoeuvre_start, emergency_stop) = match reader.latest(reader.head(), before.words_mut()) {
            Some(_) => (before.manoeuvre_start_tick, before.emergency_stop != 0),
            None => (if operated { NO_TICK } else { 0 }, false),
        };
        let server = match Server::new(bench) {
            Ok(server) => Some(server),
            Err(error) => {
                note(&format!("no operator can ask anything of this run: {error}"));
                None
            }
        };
        // After a resumption the scenario's changes that were due have been made.
        let head = if resumed { writer.head() } else { 0 };
        Ok(Desk {
            server,
            published: if resumed { book.version() } else { 0 },
            base: *base,
            schedule: schedule.changes().filter(|c| c.0 >= head).map(|(n, _, v)| (n, *v)).collect(),
            writer,
            book,
            operated,
            ticks: resolved.scenario.ticks(),
            request: None,
            request_count: 0,
            emergency_stop,
            manoeuvre_start,
            steered_at: None,
            steering: false,
        })
    }

    /// Whether arming and starting are the operator's.
    pub(crate) fn operated(&self) -> bool {
        self.operated
    }

    /// Looks for requests, scheduled changes and lost steering at tick `n`, and publishes the parameters if
    /// they changed. Notes go to `note`.
    pub(crate) fn look(
        &mut self,
        n: u64,
        now: Nanos,
        state: u64,
        plan: &mut RunPlan,
        note: &mut dyn FnMut(&str),
    ) {
        self.look_at_schedule(n);
        if self.operated && state_name(state) == "tripped" && self.manoeuvre_start != NO_TICK {
            // The manoeuvre is over; the car goes straight until somebody starts again.
            self.manoeuvre_start = NO_TICK;
            plan.never_stop();
        }
        if let Some(server) = self.server.take() {
            let served = server.serve(|asked| self.answer(asked, n, now, state, plan, note));
            match served {
                Ok(_) => self.server = Some(server),
                Err(error) => note(&format!("no operator can ask anything of this run any more: {error}")),
            }
        }
        if self.steering && self.steered_at.is_none_or(|at| now.saturating_sub(at) > STEER_MAX_NS) {
            self.steering = false;
            let off = [("human.mode".to_owned(), Setting::Number(0.0))];
            let _ = self.book.steer(&off, None);
            note("steering by hand was lost: the manoeuvre steers again");
        }
        self.publish(n);
    }

    /// Puts the parameters into the table if they changed.
    pub(crate) fn publish(&mut self, n: u64) {
        if self.book.version() != self.published {
            let words = live::words(n, self.book.version(), self.book.values());
            // Refused when this tick is published already: then at the next look.
            if self.writer.publish(n, words.words()).is_ok() {
                self.published = self.book.version();
            }
        }
    }

    /// Puts what was asked for here over what the plan asks for.
    pub(crate) fn dress(&self, bench: &mut Bench) {
        bench.emergency_stop = u64::from(self.emergency_stop);
        bench.manoeuvre_start_tick = self.manoeuvre_start;
        // The plan's stop at the end of the run comes last.
        if bench.request != request::STOP {
            bench.request = self.request.unwrap_or(bench.request);
        }
        bench.request_count += self.request_count;
    }

    fn look_at_schedule(&mut self, n: u64) {
        let since =
            if self.manoeuvre_start == NO_TICK { return } else { n.saturating_sub(self.manoeuvre_start) };
        while self.schedule.first().is_some_and(|step| step.0 <= since) {
            let (_, values) = self.schedule.remove(0);
            let settings: Vec<_> = params::difference(&self.base, &values)
                .into_iter()
                .map(|(path, _, to)| (path.to_owned(), Setting::Number(to)))
                .collect();
            self.base = values;
            // Checked when the run was made; the state is the scenario's business.
            let _ = self.book.set(&settings, None);
        }
    }

    fn answer(
        &mut self,
        asked: Request,
        n: u64,
        now: Nanos,
        state: u64,
        plan: &mut RunPlan,
        note: &mut dyn FnMut(&str),
    ) -> Answer {
        match asked {
            Request::List => self.list(),
            Request::Set { settings, source } => match self.book.set(&settings, Some(state)) {
                Ok(changes) => {
                    for change in &changes {
                        note(&format!("{source}: {} = {} (was {})", change.path, change.to, change.from));
                    }
                    Answer::Changed { version: self.book.version(), tick: n, changes }
                }
                Err(refused) => refuse(refused, &source, note),
            },
            Request::Undo { source } => match self.book.undo(Some(state)) {
                Ok(Some(changes)) => {
                    for change in &changes {
                        note(&format!("{source}: undone: {} = {}", change.path, change.to));
                    }
                    Answer::Changed { version: self.book.version(), tick: n, changes }
                }
                Ok(None) => Answer::refused("undo", "there is nothing to undo"),
                Err(refused) => refuse(refused, &source, note),
            },
            Request::Steer { mode, angle_rad, torque_n_m } => {
                let settings = [
                    ("human.mode".to_owned(), Setting::Number(f64::from(mode))),
                    ("human.steering_wheel_angle_rad".to_owned(), Setting::Number(angle_rad)),
                    ("human.steering_wheel_torque_n_m".to_owned(), Setting::Number(torque_n_m)),
                ];
                match self.book.steer(&settings, Some(state)) {
                    Ok(()) => {
                        self.steered_at = Some(now);
                        self.steering = mode != 0;
                        Answer::Done { tick: n }
                    }
                    Err(refused) => Answer::Refused(refused),
                }
            }
            Request::Operate(operation) => self.operate(operation, n, state, plan, note),
        }
    }

    fn list(&self) -> Answer {
        let entry = |(index, parameter): (usize, &params::Parameter)| {
            let default = self.book.defaults()[index];
            let (min, max) = parameter.range(default);
            let fixed = self.book.fixed(index).unwrap_or_default().to_owned();
            Entry {
                path: parameter.path.to_owned(),
                value: self.book.values()[index],
                default,
                min,
                max,
                fixed,
            }
        };
        Answer::Parameters {
            version: self.book.version(),
            undo_depth: self.book.undo_depth() as u64,
            entries: LIST.iter().enumerate().map(entry).collect(),
        }
    }

    fn operate(
        &mut self,
        operation: Operation,
        n: u64,
        state: u64,
        plan: &mut RunPlan,
        note: &mut dyn FnMut(&str),
    ) -> Answer {
        let state = state_name(state);
        let no = |reason: String| Answer::refused("operate", reason);
        let only = |wanted: &[&str]| {
            (!wanted.contains(&state)).then(|| {
                no(format!("not in state {state}: {operation:?} is possible in {} only", wanted.join(", ")))
            })
        };
        match operation {
            Operation::Arm | Operation::Start if !self.operated => {
                return no(
                    "this run arms and starts by itself; `kingpin run --operate` leaves it to you".to_owned()
                );
            }
            Operation::Acknowledge if !self.operated => {
                return no("this run ends when it trips; `kingpin run --operate` goes on".to_owned());
            }
            Operation::Arm => {
                if self.emergency_stop {
                    return no("the emergency stop is pressed: release it first".to_owned());
                }
                if let Some(refused) = only(&["idle"]) {
                    return refused;
                }
                self.ask(request::ARM);
            }
            Operation::Start => {
                if let Some(refused) = only(&["armed"]) {
                    return refused;
                }
                self.manoeuvre_start = n;
                plan.run_from(n, self.ticks);
                self.ask(request::START);
            }
            Operation::Stop if self.operated => {
                if let Some(refused) = only(&["armed", "starting", "running", "holding", "resuming"]) {
                    return refused;
                }
                self.manoeuvre_start = NO_TICK;
                plan.never_stop();
                self.ask(request::STOP);
            }
            Operation::Stop | Operation::End => plan.stop_at(n),
            Operation::Acknowledge => {
                if let Some(refused) = only(&["tripped"]) {
                    return refused;
                }
                if self.emergency_stop {
                    return no("the emergency stop is pressed: release it first".to_owned());
                }
                self.ask(request::ACKNOWLEDGE);
            }
            Operation::EmergencyStop => self.emergency_stop = true,
            Operation::ReleaseEmergencyStop => self.emergency_stop = false,
        }
        note(&format!("operator: {operation:?} at tick {n}"));
        Answer::Done { tick: n }
    }

    fn ask(&mut self, asked: u64) {
        self.request = Some(asked);
        self.request_count += 1;
    }
}

fn refuse(refused: Vec<Refusal>, source: &str, note: &mut dyn FnMut(&str)) -> Answer {
    for refusal in &refused {
        note(&format!("{source}: refused: {refusal}"));
    }
    Answer::Refused(refused)
}
