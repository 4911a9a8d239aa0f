//! End-to-end protection: counters and checksums of messages, made and checked.
//!
//! AUTOSAR profiles 1, 2, 5 and 11 after AUTOSAR FO PRS E2EProtocol R23-11 (chapters 6.3, 6.4, 6.7, 6.11); the
//! CRCs after AUTOSAR CP SWS CRCLibrary. Makers' schemes as reverse engineered by the opendbc project (MIT),
//! whose CRC parameters follow crcmod: its start value is that of an empty message, so its `init 0x00,
//! xor 0xFF` is a register that starts at 0xFF. Checking follows the profiles' state machine: a frame is good,
//! or good with some lost, repeated, out of sequence, or wrong.

use crate::frame::Id;
use crate::signal::Bits;
use config::can::{DataIdMode, MakerScheme};
use crc::{Algorithm, Crc};

const fn crc8(poly: u8, init: u8, xorout: u8) -> Algorithm<u8> {
    Algorithm { width: 8, poly, init, refin: false, refout: false, xorout, check: 0, residue: 0 }
}

/// Profiles 1 and 11: SAE J1850 without start value and final XOR (the profile undoes the library's).
const J1850_ZERO: Crc<u8> = {
    const A: Algorithm<u8> = crc8(0x1D, 0x00, 0x00);
    Crc::<u8>::new(&A)
};
/// SAE J1850.
const J1850: Crc<u8> = Crc::<u8>::new(&crc::CRC_8_SAE_J1850);
/// CRC-8H2F.
const H2F: Crc<u8> = Crc::<u8>::new(&crc::CRC_8_AUTOSAR);
/// Hyundai's: opendbc's init 0xFD is that of an empty message: 0xFD ^ 0xDF.
const HYUNDAI: Crc<u8> = {
    const A: Algorithm<u8> = crc8(0x1D, 0x22, 0xDF);
    Crc::<u8>::new(&A)
};
/// CRC-16 CCITT-FALSE.
const CCITT: Crc<u16> = Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// The rule that fills the checksum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Rule {
    /// AUTOSAR profile 1 or 11.
    J1850WithId {
        /// Data ID.
        data_id: u16,
        /// Which part of it.
        mode: DataIdMode,
    },
    /// AUTOSAR profile 2, and Volkswagen MQB.
    H2fWithList {
        /// Data ID of each counter value.
        list: [u8; 16],
    },
    /// AUTOSAR profile 5.
    CcittWithId {
        /// Data ID.
        data_id: u16,
    },
    /// A maker's, without parameters.
    Maker(MakerScheme),
    /// A counter alone.
    None,
}

/// Counter and checksum of one message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Protection {
    /// Rule of the checksum.
    pub rule: Rule,
    /// Where the checksum is.
    pub checksum: Option<Bits>,
    /// Where the counter is.
    pub counter: Option<Bits>,
    /// Where the Data ID's nibble is.
    pub nibble: Option<Bits>,
    /// Greatest counter value.
    pub counter_max: u64,
    /// Largest step of the counter that is accepted.
    pub delta_max: u64,
}

/// What a received frame is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The first one: no step to judge.
    Initial,
    /// Next in sequence.
    Ok,
    /// Good, but up to the allowed number before it were lost.
    SomeLost,
    /// The counter did not move.
    Repeated,
    /// The counter moved too far, or backwards.
    WrongSequence,
    /// Checksum, counter value or Data ID nibble are wrong.
    Wrong,
}

impl Verdict {
    /// Whether the content may be used.
    pub fn good(self) -> bool {
        matches!(self, Verdict::Initial | Verdict::Ok | Verdict::SomeLost)
    }
}

/// What a receiver remembers of a message.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CheckState {
    last: Option<u64>,
}

impl Protection {
    /// The counter that follows `counter`.
    pub fn next(&self, counter: u64) -> u64 {
        if counter >= self.counter_max { 0 } else { counter + 1 }
    }

    /// Writes counter, nibble and checksum.
    pub fn protect(&self, id: Id, data: &mut [u8], counter: u64) {
        if let Some(bits) = &self.counter {
            bits.set(data, counter);
        }
        if let (Some(bits), Rule::J1850WithId { data_id, .. }) = (&self.nibble, &self.rule) {
            bits.set(data, u64::from(data_id >> 8 & 0xF));
        }
        if let Some(bits) = &self.checksum {
            let sum = self.sum(id, data);
            bits.set(data, sum);
        }
    }

    /// Spoils the checksum, for fault injection.
    pub fn spoil(&self, data: &mut [u8]) {
        if let Some(bits) = &self.checksum {
            let sum = bits.get(data);
            bits.set(data, !sum);
        }
    }

    /// Whether there is a checksum to be wrong.
    pub fn has_checksum(&self) -> bool {
        self.checksum.is_some()
    }

    /// The checksum that `data` should have; its own bits do not count.
    pub fn sum(&self, id: Id, data: &[u8]) -> u64 {
        let at = self.checksum.as_ref().map_or(data.len(), |bits| bits.lowest().0);
        let counter = self.counter.as_ref().map_or(0, |bits| bits.get(data));
        match &self.rule {
            Rule::None => 0,
            Rule::J1850WithId { data_id, mode } => {
                let [low, high] = data_id.to_le_bytes();
                let mut digest = J1850_ZERO.digest();
                match mode {
                    DataIdMode::Both => digest.update(&[low, high]),
                    DataIdMode::Alternating if counter.is_multiple_of(2) => digest.update(&[low]),
                    DataIdMode::Alternating => digest.update(&[high]),
                    DataIdMode::Low => digest.update(&[low]),
                    DataIdMode::Nibble => digest.update(&[low, 0]),
                }
                digest.update(&data[..at]);
                digest.update(&data[at + 1..]);
                u64::from(digest.finalize())
            }
            Rule::H2fWithList { list } => {
                let mut digest = H2F.digest();
                digest.update(&data[1..]);
                digest.update(&[list[(counter & 0xF) as usize]]);
                u64::from(digest.finalize())
            }
            Rule::CcittWithId { data_id } => {
                let mut digest = CCITT.digest();
                digest.update(&data[..at]);
                digest.update(&data[at + 2..]);
                digest.update(&data_id.to_le_bytes());
                u64::from(digest.finalize())
            }
            Rule::Maker(scheme) => u64::from(self.maker_sum(*scheme, id, data, at)),
        }
    }

    fn maker_sum(&self, scheme: MakerScheme, id: Id, data: &[u8], at: usize) -> u8 {
        let bytes = |range: &[u8]| range.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
        let address = id.number().to_le_bytes();
        match scheme {
            MakerScheme::Toyota => {
                let last = data.len().saturating_sub(1);
                (data.len() as u8).wrapping_add(bytes(&address)).wrapping_add(bytes(&data[..last]))
            }
            MakerScheme::Tesla => bytes(&address[..2]).wrapping_add(bytes(data)).wrapping_sub(data[at]),
            MakerScheme::Nissan => J1850.checksum(&data[..data.len().saturating_sub(1)]),
            MakerScheme::HyundaiCrc8 => {
                let mut digest = HYUNDAI.digest();
                digest.update(&data[..at]);
                digest.update(&data[at + 1..]);
                digest.finalize()
            }
            MakerScheme::HyundaiSum6 => bytes(&data[..6]),
            MakerScheme::HyundaiSum7 => bytes(&data[..6]).wrapping_add(data[7]),
            MakerScheme::HyundaiNibble => {
                // Over the frame with the checksum's own bits at 0.
                let own = self.checksum.as_ref().map_or(0, |bits| bits.get(data) as u8 & 0xF);
                let sum =
                    data.iter().fold(0u8, |sum, byte| sum.wrapping_add(byte >> 4).wrapping_add(byte & 0xF));
                0x10u8.wrapping_sub(sum.wrapping_sub(own) & 0xF) & 0xF
            }
            // With its constants: [`Rule::H2fWithList`].
            MakerScheme::VwMqb => 0,
        }
    }

    /// Judges a frame and remembers its counter.
    pub fn check(&self, id: Id, data: &[u8], state: &mut CheckState) -> Verdict {
        if let Some(bits) = &self.checksum
            && bits.get(data) != self.sum(id, data)
        {
            return Verdict::Wrong;
        }
        if let (Some(bits), Rule::J1850WithId { data_id, .. }) = (&self.nibble, &self.rule)
            && bits.get(data) != u64::from(data_id >> 8 & 0xF)
        {
            return Verdict::Wrong;
        }
        let Some(bits) = &self.counter else { return Verdict::Ok };
        let counter = bits.get(data);
        if counter > self.counter_max {
            return Verdict::Wrong;
        }
        let Some(last) = state.last.replace(counter) else { return Verdict::Initial };
        let modulus = self.counter_max + 1;
        match (counter + modulus - last) % modulus {
            0 => Verdict::Repeated,
            1 => Verdict::Ok,
            delta if delta <= self.delta_max => Verdict::SomeLost,
            _ => Verdict::WrongSequence,
        }
    }
}

impl Protection {
    /// Frames lost between two states of a receiver, by the counter.
    pub fn lost(&self, before: CheckState, after: CheckState) -> u64 {
        match (before.last, after.last) {
            (Some(before), Some(after)) => {
                let modulus = self.counter_max + 1;
                ((after + modulus - before) % modulus).saturating_sub(1)
            }
            _ => 0,
        }
    }
}
