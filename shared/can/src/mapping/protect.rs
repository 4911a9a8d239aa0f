//! The signals that hold a message's counter and checksum, as their rule needs them; layouts as the AUTOSAR E2E
//! profiles and the makers' schemes lay down (see [`crate::e2e`]).

use super::{Faults, find_signal};
use crate::database::Message;
use crate::e2e::{Protection, Rule};
use crate::signal::Bits;
use config::can::{DataIdMode, MakerScheme, Protection as Wanted};

/// Finds what is wanted in the message, or notes what does not fit. The signals found are `taken`.
pub(super) fn protect(
    message: &Message,
    wanted: Option<&Wanted>,
    at: &str,
    taken: &mut Vec<usize>,
    faults: &mut Faults,
) -> Option<Protection> {
    let before = faults.0.len();
    let mut finder = Finder { message, at, taken, faults };
    let protection = match wanted? {
        Wanted::AutosarP01 {
            checksum,
            counter,
            data_id_nibble,
            data_id,
            data_id_mode,
            max_delta_counter,
        } => {
            let held = finder.one(checksum, counter, data_id_nibble.as_deref(), *data_id, *data_id_mode);
            Protection { delta_max: u64::from(*max_delta_counter), ..held }
        }
        Wanted::AutosarP11 {
            checksum,
            counter,
            data_id_nibble,
            data_id,
            data_id_mode,
            max_delta_counter,
        } => {
            if !matches!(data_id_mode, DataIdMode::Both | DataIdMode::Nibble) {
                finder.note("data_id_mode", Some(checksum), "profile 11 knows `both` and `nibble` only");
            }
            let held = finder.one(checksum, counter, data_id_nibble.as_deref(), *data_id, *data_id_mode);
            Protection { delta_max: u64::from(*max_delta_counter), ..held }
        }
        Wanted::AutosarP02 { checksum, counter, data_id_list, max_delta_counter } => {
            let checksum_bits = finder.hold("checksum", checksum, Some(8));
            let counter_bits = finder.hold("counter", counter, Some(4));
            if checksum_bits.is_some_and(|bits| bits.whole_bytes() != Some(0..1)) {
                finder.note("checksum", Some(checksum), "must be byte 0");
            }
            if counter_bits.is_some_and(|bits| bits.lowest() != (1, 0)) {
                finder.note("counter", Some(counter), "must be the low nibble of byte 1");
            }
            let mut list = [0; 16];
            list.iter_mut().zip(data_id_list).for_each(|(to, from)| *to = *from);
            Protection {
                rule: Rule::H2fWithList { list },
                checksum: checksum_bits,
                counter: counter_bits,
                nibble: None,
                counter_max: 15,
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::AutosarP05 { checksum, counter, data_id, max_delta_counter } => {
            let checksum_bits = finder.hold("checksum", checksum, Some(16));
            if checksum_bits.is_some_and(|bits| bits.whole_bytes().is_none() || !bits.low_byte_first()) {
                finder.note("checksum", Some(checksum), "must be two whole bytes, little endian");
            }
            Protection {
                rule: Rule::CcittWithId { data_id: *data_id },
                checksum: checksum_bits,
                counter: finder.hold("counter", counter, Some(8)),
                nibble: None,
                counter_max: 255,
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::Maker { scheme, checksum, counter, counter_max, constants, max_delta_counter } => {
            let size = if *scheme == MakerScheme::HyundaiNibble { 4 } else { 8 };
            let checksum_bits = finder.hold("checksum", checksum, Some(size));
            let counter_bits = counter.as_ref().and_then(|name| finder.hold("counter", name, None));
            if let Some(wrong) = misplaced(*scheme, checksum_bits, message.len) {
                finder.note("checksum", Some(checksum), wrong);
            }
            Protection {
                rule: finder.makers_rule(*scheme, checksum, constants.as_deref()),
                checksum: checksum_bits,
                counter: counter_bits,
                nibble: None,
                counter_max: finder.greatest(counter.as_deref(), counter_bits, *counter_max),
                delta_max: u64::from(*max_delta_counter),
            }
        }
        Wanted::CounterOnly { counter, counter_max, max_delta_counter } => {
            let bits = finder.hold("counter", counter, None);
            Protection {
                rule: Rule::None,
                checksum: None,
                counter: bits,
                nibble: None,
                counter_max: finder.greatest(Some(counter), bits, *counter_max),
                delta_max: u64::from(*max_delta_counter),
            }
        }
    };
    (faults.0.len() == before).then_some(protection)
}

/// What is wrong with where a maker's checksum lies, if it was found, and with the message's length.
fn misplaced(scheme: MakerScheme, checksum: Option<Bits>, message_len: usize) -> Option<&'static str> {
    let found = checksum.is_some();
    let byte = checksum.and_then(|bits| bits.whole_bytes()).map(|bytes| bytes.start);
    let last = message_len.saturating_sub(1);
    match scheme {
        MakerScheme::Toyota | MakerScheme::Nissan if found && byte != Some(last) => {
            Some("must be the last byte")
        }
        MakerScheme::VwMqb if found && byte != Some(0) => Some("must be byte 0"),
        MakerScheme::HyundaiCrc8 | MakerScheme::Tesla if found && byte.is_none() => {
            Some("must be one whole byte")
        }
        MakerScheme::HyundaiSum6 | MakerScheme::HyundaiSum7 if message_len != 8 => {
            Some("needs a message of 8 bytes")
        }
        _ => None,
    }
}

/// Looks for signals in one message.
struct Finder<'a> {
    message: &'a Message,
    at: &'a str,
    taken: &'a mut Vec<usize>,
    faults: &'a mut Faults,
}

impl Finder<'_> {
    fn note(&mut self, key: &str, signal: Option<&str>, rule: impl std::fmt::Display) {
        self.faults.note(format!("{}.protection.{key}", self.at), &self.message.name, signal, rule);
    }

    /// The bits of the signal that `key` names; of `size` bits, if that is laid down.
    fn hold(&mut self, key: &str, name: &str, size: Option<u32>) -> Option<Bits> {
        let (index, signal) =
            find_signal(self.message, name, format!("{}.protection.{key}", self.at), self.faults)?;
        let bits = signal.codec.bits;
        if let Some(size) = size.filter(|size| bits.size() != *size) {
            let rule = format!("must have {size} bits for this protection, has {}", bits.size());
            self.note(key, Some(name), rule);
            return None;
        }
        self.taken.push(index);
        Some(bits)
    }

    /// Profiles 1 and 11; the greatest step of the counter is not looked at.
    fn one(
        &mut self,
        checksum: &str,
        counter: &str,
        nibble: Option<&str>,
        data_id: u16,
        mode: DataIdMode,
    ) -> Protection {
        let checksum_bits = self.hold("checksum", checksum, Some(8));
        if checksum_bits.is_some_and(|bits| bits.whole_bytes().is_none()) {
            self.note("checksum", Some(checksum), "must be one whole byte");
        }
        let counter = self.hold("counter", counter, Some(4));
        let by_nibble = mode == DataIdMode::Nibble;
        let nibble = match nibble {
            Some(name) if by_nibble => self.hold("data_id_nibble", name, Some(4)),
            Some(name) => {
                self.note("data_id_nibble", Some(name), "is for mode `nibble` only");
                None
            }
            None if by_nibble => {
                let rule = "mode `nibble` needs the signal of the nibble";
                self.note("data_id_nibble", Some(checksum), rule);
                None
            }
            None => None,
        };
        if by_nibble && data_id >> 12 != 0 {
            let rule = format!("data ID {data_id} must be below 4096 in mode `nibble`");
            self.note("data_id", Some(checksum), rule);
        }
        let rule = Rule::J1850WithId { data_id, mode };
        Protection { rule, checksum: checksum_bits, counter, nibble, counter_max: 14, delta_max: 0 }
    }

    /// A maker's rule with its constants.
    fn makers_rule(&mut self, scheme: MakerScheme, checksum: &str, constants: Option<&[u8]>) -> Rule {
        let wrong = match (scheme, constants) {
            (MakerScheme::VwMqb, Some(&[constant])) => return Rule::H2fWithList { list: [constant; 16] },
            (MakerScheme::VwMqb, constants) => {
                if let Some(list) = constants.and_then(|all| <[u8; 16]>::try_from(all).ok()) {
                    return Rule::H2fWithList { list };
                }
                "`vw_mqb` needs the message's constant: one, or one for each of 16 counter values"
            }
            (_, Some(_)) => "is for `vw_mqb` only",
            (scheme, None) => return Rule::Maker(scheme),
        };
        self.note("constants", Some(checksum), wrong);
        Rule::None
    }

    /// Greatest value of a counter: as said, else what its bits hold.
    fn greatest(&mut self, name: Option<&str>, bits: Option<Bits>, said: Option<u8>) -> u64 {
        let Some(bits) = bits else { return 0 };
        if bits.size() > 8 {
            self.note("counter", name, format!("a counter has at most 8 bits, not {}", bits.size()));
            return 0;
        }
        let top = u64::MAX >> (64 - bits.size());
        let max = said.map_or(top, u64::from);
        if max > top {
            self.note("counter_max", name, format!("{max} does not fit {} bits", bits.size()));
        }
        max
    }
}
