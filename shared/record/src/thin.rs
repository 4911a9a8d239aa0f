//! Fewer ticks of a log, by a stated method.
//!
//! Blocks of N ticks are counted from tick 0 and carry the number of their first tick. `Pick` keeps that tick as it is:
//! quick and exact, but what is faster than half the new rate folds into what is slower (aliasing). `Mean` takes the
//! arithmetic mean of every floating-point column over the ticks of the block that are there and hold a finite number
//! (absent if none does), so of a region's own `time_s` too: the time the mean is valid for. Counters, codes and
//! flags are those of the block's first tick in both. The mean's response is sin(πfNT)/(N·sin(πfT)), its zero at 1/(NT).

use crate::reader::{LogReader, RegionLog};
use regions::Kind;

/// How ticks are thinned out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Decimation {
    /// The first tick of each block as it is.
    #[default]
    Pick,
    /// The mean over each block.
    Mean,
}

impl LogReader {
    /// The log with one row for every `every` ticks; its header says so. 0 and 1 leave it as it is.
    #[must_use]
    pub fn thinned(mut self, every: u64, method: Decimation) -> LogReader {
        if every < 2 {
            return self;
        }
        for region in self.regions_mut() {
            match method {
                Decimation::Pick => pick(region, every),
                Decimation::Mean => average(region, every),
            }
        }
        self.header.decimation = Some(match method {
            Decimation::Pick => format!("every {every}th tick, counted from tick 0, as it is"),
            Decimation::Mean => {
                format!("mean over {every} ticks, counted from tick 0; counters of the first")
            }
        });
        self
    }
}

fn pick(region: &mut RegionLog, every: u64) {
    let rows: Vec<usize> =
        (0..region.ticks.len()).filter(|&row| region.ticks[row].is_multiple_of(every)).collect();
    let words = rows.iter().flat_map(|&row| region.row(row).to_vec()).collect();
    region.ticks = rows.iter().map(|&row| region.ticks[row]).collect();
    region.set_words(words);
}

fn average(region: &mut RegionLog, every: u64) {
    let width = region.columns.len();
    let (mut ticks, mut words) = (Vec::new(), Vec::new());
    let mut from = 0;
    while let Some(&tick) = region.ticks.get(from) {
        let block = tick / every;
        let to = from + region.ticks[from..].iter().take_while(|&&t| t / every == block).count();
        ticks.push(block * every);
        for column in 0..width {
            let first = region.row(from)[column];
            words.push(match (column, region.columns[column].kind) {
                (0, _) => block * every,
                (_, Kind::U64) => first,
                (_, Kind::F64) => {
                    let values = (from..to).map(|row| f64::from_bits(region.row(row)[column]));
                    let (sum, count) = values
                        .filter(|value| value.is_finite())
                        .fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
                    // None is there: 0/0, absent.
                    (sum / f64::from(count)).to_bits()
                }
            });
        }
        from = to;
    }
    region.ticks = ticks;
    region.set_words(words);
}
