//! Instrumentation of the simulation step: records, for each part of the step, how much a meter increases during this part. A meter
//! counts nanoseconds, operations or instructions.

use std::cell::RefCell;
use std::hint::black_box;
use std::time::Instant;

use stepper_core::internals::probe::{Counter, Probe, Span};

/// Number of values in a meter reading, such as the three numbers of sums, divisions and other operations.
pub const READINGS: usize = 3;
const SPANS: usize = Span::ALL.len();
const COUNTERS: usize = Counter::ALL.len();

/// Meter: a function that returns a reading of up to three counters, which only increase.
///
/// The recorder calls it at each start and end of a span (an instrumented part of the step). The argument is the span that was active
/// until then, or `None` outside all spans.
pub type Meter = fn(Option<Span>) -> [u64; READINGS];

/// Instrumentation of a step (a probe): adds the meter readings of the step's parts, and numbers of events such as contacts, to the
/// recording in progress on its thread.
///
/// Without a recording in progress the recorder does nothing. The type has no fields, so that passing it by value costs nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Recorder;

/// Recorded meter readings of the parts of one or more steps, and numbers of counted events such as contacts.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Record of each span (instrumented part of the step), in the order of [`Span::ALL`].
    pub spans: [Row; SPANS],
    /// Record of the work outside all spans.
    pub unaccounted: Row,
    /// Number of events of each kind, such as contacts, in the order of [`Counter::ALL`].
    pub counters: [f64; COUNTERS],
}

/// Record of one part of the step: a span, or the work outside all spans.
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// Number of times that the part was entered.
    pub times: f64,
    /// Number of spans that began directly inside this part.
    pub inner: f64,
    /// Increase of the meter readings during the part, without the increase during other spans inside the part.
    pub readings: [f64; READINGS],
}

impl Default for Recording {
    fn default() -> Self {
        Self { spans: [Row::default(); SPANS], unaccounted: Row::default(), counters: [0.0; COUNTERS] }
    }
}

impl Recording {
    fn row(&mut self, span: Option<Span>) -> &mut Row {
        span.map_or(&mut self.unaccounted, |span| &mut self.spans[span as usize])
    }

    /// Name and record of each part of the step: all spans, and last the work outside all spans.
    pub fn rows(&self) -> impl Iterator<Item = (&'static str, Row)> {
        let spans = Span::ALL.iter().map(|span| span.name()).zip(self.spans);
        spans.chain([("unaccounted", self.unaccounted)])
    }

    /// First number of the meter readings, summed over all parts of the step. With the meter [`nanoseconds`] the sum is the total time, ns.
    pub fn sum(&self) -> f64 {
        self.rows().map(|(_, row)| row.readings[0]).sum()
    }

    /// Mean number of events of the kind `counter` in a step.
    ///
    /// Events that all environments of a SIMD group share are divided by the number of group steps. Other numbers are returned unchanged.
    /// Before this call, divide the recording by the number of environment steps, with the weight of [`Recording::add`].
    pub fn mean(&self, counter: Counter) -> f64 {
        let steps = if counter.is_shared() { self.counters[Counter::GroupSteps as usize] } else { 1.0 };
        self.counters[counter as usize] / steps
    }

    /// Adds all numbers of another recording to this recording, multiplied by `weight`.
    pub fn add(&mut self, other: &Self, weight: f64) {
        let rows = self.spans.iter_mut().chain([&mut self.unaccounted]);
        for (sum, row) in rows.zip(other.spans.iter().chain([&other.unaccounted])) {
            sum.times += weight * row.times;
            sum.inner += weight * row.inner;
            sum.readings.iter_mut().zip(row.readings).for_each(|(sum, x)| *sum += weight * x);
        }
        self.counters.iter_mut().zip(other.counters).for_each(|(sum, x)| *sum += weight * x);
    }

    /// Subtracts the cost of the instrumentation (the probe) from the first number of the meter readings of each part.
    ///
    /// `inside` is the cost that each span adds to its own reading, and `outside` is the cost that each span adds to the part around the
    /// span.
    pub fn subtract_probe(&mut self, [inside, outside]: [f64; 2]) {
        for row in self.spans.iter_mut().chain([&mut self.unaccounted]) {
            row.readings[0] -= row.times * inside + row.inner * outside;
        }
    }
}

/// Recording in progress on a thread.
struct Tape {
    meter: Meter,
    open: Vec<Span>,
    last: [u64; READINGS],
    recording: Recording,
}

impl Tape {
    /// Reads the meter, and adds its increase since the last reading to the record of the innermost open span.
    fn boundary(&mut self) {
        let within = self.open.last().copied();
        let now = (self.meter)(within);
        let row = self.recording.row(within);
        for ((sum, now), last) in row.readings.iter_mut().zip(now).zip(self.last) {
            *sum += (now - last) as f64;
        }
        self.last = now;
    }

    fn enter(&mut self, span: Span) {
        self.boundary();
        self.recording.row(self.open.last().copied()).inner += 1.0;
        self.recording.row(Some(span)).times += 1.0;
        self.open.push(span);
    }

    fn leave(&mut self) {
        self.boundary();
        self.open.pop();
    }
}

thread_local! {
    static TAPE: RefCell<Option<Tape>> = const { RefCell::new(None) };
}

fn on_tape(act: impl FnOnce(&mut Tape)) {
    TAPE.with_borrow_mut(|tape| tape.as_mut().map(act));
}

impl Probe for Recorder {
    // Inlined, so that the work is compiled as a part of the kernel that contains it, as with `NoProbe`.
    #[inline(always)]
    fn span<T>(self, span: Span, work: impl FnOnce() -> T) -> T {
        on_tape(|tape| tape.enter(span));
        let done = work();
        on_tape(Tape::leave);
        done
    }

    #[inline(always)]
    fn count(self, counter: Counter, number: impl FnOnce() -> f64) {
        on_tape(|tape| tape.recording.counters[counter as usize] += number());
    }
}

/// Runs `work`, and returns the recording of the steps that it makes on this thread, with readings of `meter`.
pub fn record(meter: Meter, work: impl FnOnce()) -> Recording {
    let last = meter(None);
    TAPE.set(Some(Tape { meter, open: Vec::with_capacity(16), last, recording: Recording::default() }));
    work();
    let mut tape = TAPE.take().expect("set above, and work within work records nothing");
    tape.boundary();
    tape.recording
}

/// Meter of wall-clock time: nanoseconds since its first call.
///
/// A reading of the processor time would take ten times as long as a small part of a step. Repeated rounds of the same work reveal
/// interruptions.
pub fn nanoseconds(_: Option<Span>) -> [u64; READINGS] {
    thread_local! {
        static START: Instant = Instant::now();
    }
    [START.with(Instant::elapsed).as_nanos() as u64, 0, 0]
}

/// Measured cost of the instrumentation per span (instrumented part of a step), ns.
///
/// The first number is the time that it adds to the span, and the second one the time that it adds to the part around the span.
pub fn own_cost() -> [f64; 2] {
    const TIMES: usize = 1000;
    let round = || {
        let found = record(nanoseconds, || (0..TIMES).for_each(|_| Recorder.span(Span::Solve, || black_box(()))));
        [found.spans[Span::Solve as usize], found.unaccounted].map(|row| row.readings[0] / TIMES as f64)
    };
    (0..100).map(|_| round()).min_by(|a, b| a.iter().sum::<f64>().total_cmp(&b.iter().sum())).expect("there are rounds")
}

#[cfg(test)]
mod tests {
    use super::*;

    thread_local! {
        static NOW: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
    }

    fn hand(_: Option<Span>) -> [u64; READINGS] {
        [NOW.get(), 0, 0]
    }

    #[test]
    fn rows_sum_to_the_whole_and_inner_spans_are_left_out() {
        let pass = |n: u64| NOW.set(NOW.get() + n);
        let found = record(hand, || {
            pass(1);
            Recorder.span(Span::Solve, || {
                pass(10);
                Recorder.span(Span::Load, || pass(100));
                Recorder.span(Span::Load, || pass(200));
                Recorder.count(Counter::Sweeps, || 3.0);
            });
            pass(2);
        });
        let [solve, load] = [Span::Solve, Span::Load].map(|span| found.spans[span as usize]);
        assert_eq!((solve.times, solve.inner, solve.readings[0]), (1.0, 2.0, 10.0));
        assert_eq!((load.times, load.inner, load.readings[0]), (2.0, 0.0, 300.0));
        assert_eq!((found.unaccounted.readings[0], found.sum()), (3.0, 313.0));
        assert_eq!(found.counters[Counter::Sweeps as usize], 3.0);
    }
}
