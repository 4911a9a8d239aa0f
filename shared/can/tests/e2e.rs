//! Counters and checksums against published vectors, frames recorded in cars, and the state machine's rules.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use can::Id;
use can::e2e::{CheckState, Protection, Rule, Verdict};
use can::signal::Bits;
use config::can::{DataIdMode, MakerScheme};

fn bits(start: u64, size: u64) -> Option<Bits> {
    Some(Bits::new(start, size, false).unwrap())
}

fn profile_1(data_id: u16, mode: DataIdMode) -> Protection {
    Protection {
        rule: Rule::J1850WithId { data_id, mode },
        checksum: bits(0, 8),
        counter: bits(8, 4),
        nibble: if mode == DataIdMode::Nibble { bits(12, 4) } else { None },
        counter_max: 14,
        delta_max: 3,
    }
}

fn profile_2(list: [u8; 16]) -> Protection {
    Protection {
        rule: Rule::H2fWithList { list },
        checksum: bits(0, 8),
        counter: bits(8, 4),
        nibble: None,
        counter_max: 15,
        delta_max: 3,
    }
}

fn profile_5(offset_bytes: u64, data_id: u16) -> Protection {
    Protection {
        rule: Rule::CcittWithId { data_id },
        checksum: bits(8 * offset_bytes, 16),
        counter: bits(8 * offset_bytes + 16, 8),
        nibble: None,
        counter_max: 255,
        delta_max: 3,
    }
}

fn maker(scheme: MakerScheme, start: u64, size: u64) -> Protection {
    Protection {
        rule: Rule::Maker(scheme),
        checksum: bits(start, size),
        counter: None,
        nibble: None,
        counter_max: 0,
        delta_max: 1,
    }
}

const ID: Id = Id::Standard(0x123);

fn protected(protection: &Protection, counter: u64, len: usize) -> Vec<u8> {
    let mut data = vec![0; len];
    protection.protect(ID, &mut data, counter);
    data
}

/// AUTOSAR CP SWS CRCLibrary R23-11, tables of example results: the CRCs that the profiles are made of.
#[test]
fn crcs_give_the_librarys_published_results() {
    let inputs: [&[u8]; 7] = [
        &[0, 0, 0, 0],
        &[0xF2, 0x01, 0x83],
        &[0x0F, 0xAA, 0x00, 0x55],
        &[0x00, 0xFF, 0x55, 0x11],
        &[0x33, 0x22, 0x55, 0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF],
        &[0x92, 0x6B, 0x55],
        &[0xFF, 0xFF, 0xFF, 0xFF],
    ];
    let j1850 = [0x59, 0x37, 0x79, 0xB8, 0xCB, 0x8C, 0x74];
    let h2f = [0x12, 0xC2, 0xC6, 0x77, 0x11, 0x33, 0x6C];
    let ccitt = [0x84C0, 0xD374, 0x2023, 0xB8F9, 0xF53F, 0x0745, 0x1D0F];
    for (i, input) in inputs.iter().enumerate() {
        // Nissan's is plain SAE J1850 over all but the last byte.
        let frame = [input, &[0][..]].concat();
        let at = 8 * input.len() as u64;
        assert_eq!(maker(MakerScheme::Nissan, at, 8).sum(ID, &frame), j1850[i], "J1850 of {input:02X?}");
        // Profile 2 takes everything behind its CRC, then the list's entry: the input's last byte here.
        let (last, rest) = input.split_last().unwrap();
        let frame = [&[0][..], rest].concat();
        let mut protection = profile_2([*last; 16]);
        protection.counter = None;
        assert_eq!(protection.sum(ID, &frame), h2f[i], "H2F of {input:02X?}");
        // Profile 5 ends with the Data ID, low byte first.
        let (rest, id) = input.split_at(input.len() - 2);
        let frame = [&[0, 0][..], rest].concat();
        let protection = profile_5(0, u16::from_le_bytes([id[0], id[1]]));
        assert_eq!(protection.sum(ID, &frame), ccitt[i], "CCITT of {input:02X?}");
    }
}

/// AUTOSAR FO PRS E2EProtocol, protocol examples of profiles 1/11 and 5 (all-zero data).
#[test]
fn profiles_give_the_protocol_examples() {
    let both = profile_1(0x123, DataIdMode::Both);
    assert_eq!(protected(&both, 0, 8), [0xCC, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(protected(&both, 1, 8), [0x91, 1, 0, 0, 0, 0, 0, 0]);
    let nibble = profile_1(0x123, DataIdMode::Nibble);
    assert_eq!(protected(&nibble, 0, 8), [0x2A, 0x10, 0, 0, 0, 0, 0, 0]);
    assert_eq!(protected(&nibble, 1, 8), [0x77, 0x11, 0, 0, 0, 0, 0, 0]);
    // Profile 1's other modes, as the independent implementation of package autosar-e2e 1.0.0 gives them.
    assert_eq!(protected(&profile_1(0x123, DataIdMode::Low), 1, 8)[..2], [0x93, 1]);
    assert_eq!(protected(&profile_1(0x123, DataIdMode::Alternating), 0, 8)[..2], [0xCE, 0]);
    assert_eq!(protected(&profile_1(0x123, DataIdMode::Alternating), 1, 8)[..2], [0x02, 1]);
    assert_eq!(protected(&profile_5(0, 0x1234), 0, 8), [0x1C, 0xCA, 0, 0, 0, 0, 0, 0]);
    let offset = protected(&profile_5(8, 0x1234), 0, 16);
    assert_eq!(offset[8..], [0x28, 0x91, 0, 0, 0, 0, 0, 0]);
    // Profile 2: the published tests of package autosar-e2e.
    assert_eq!(protected(&profile_2([0; 16]), 1, 8), [0x45, 1, 0, 0, 0, 0, 0, 0]);
    let list = std::array::from_fn(|i| i as u8);
    let mut data = [0, 1, 2, 3, 4, 5, 6, 7];
    profile_2(list).protect(ID, &mut data, 2);
    assert_eq!(data, [0xBC, 2, 2, 3, 4, 5, 6, 7]);
}

/// Frames recorded in Volkswagen MQB cars (steering angle 0x086 and steering 0x09F), one for each counter value;
/// from the opendbc project's tests of its checksums, MIT licence.
#[test]
fn frames_recorded_in_cars_are_good_and_their_neighbours_are_not() {
    let recorded: [(u32, u8, [[u8; 8]; 6]); 2] = [
        (
            0x86,
            0x86,
            [
                [0x6b, 0x00, 0xbd, 0x00, 0x00, 0x00, 0x00, 0x00],
                [0xee, 0x01, 0x0a, 0x00, 0x00, 0x00, 0x00, 0x00],
                [0x03, 0x03, 0xbe, 0xa2, 0x12, 0x00, 0x00, 0x00],
                [0x8b, 0x05, 0xe2, 0x85, 0x09, 0x00, 0x00, 0x00],
                [0xaf, 0x0a, 0x72, 0x20, 0x00, 0x00, 0x00, 0x00],
                [0x60, 0x0f, 0x62, 0xc0, 0x00, 0x00, 0x00, 0x00],
            ],
        ),
        (
            0x9F,
            0xF5,
            [
                [0x11, 0x30, 0x2e, 0x00, 0x05, 0x1c, 0x80, 0x30],
                [0x5b, 0x31, 0x8e, 0x03, 0x05, 0x53, 0x00, 0x30],
                [0xcb, 0x32, 0xd3, 0x06, 0x05, 0x73, 0x00, 0x30],
                [0x68, 0x38, 0x06, 0x01, 0x05, 0x18, 0x80, 0x30],
                [0x8c, 0x3a, 0x29, 0x00, 0x05, 0xac, 0x00, 0x30],
                [0xe2, 0x3f, 0x05, 0x00, 0x05, 0x0a, 0x00, 0x30],
            ],
        ),
    ];
    for (id, constant, frames) in recorded {
        let id = Id::Standard(id as u16);
        let protection = profile_2([constant; 16]);
        for frame in frames {
            assert_eq!(protection.sum(id, &frame), u64::from(frame[0]), "{frame:02x?}");
            for bit in 0..64 {
                let mut wrong = frame;
                wrong[bit / 8] ^= 1 << (bit % 8);
                let verdict = protection.check(id, &wrong, &mut CheckState::default());
                assert_eq!(verdict, Verdict::Wrong, "bit {bit} of {frame:02x?}");
            }
        }
    }
}

/// What opendbc 0.3.1 computes for one payload (it starts its CRC registers as crcmod does: 0x00 ^ 0xFF for
/// Nissan, 0xFD ^ 0xDF for Hyundai).
#[test]
fn makers_sums_are_opendbcs() {
    let data = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x70, 0x00];
    assert_eq!(maker(MakerScheme::Nissan, 56, 8).sum(Id::Standard(0x169), &data), 0x83);
    assert_eq!(maker(MakerScheme::Toyota, 56, 8).sum(Id::Standard(0x260), &data), 0x3F);
    assert_eq!(maker(MakerScheme::Tesla, 56, 8).sum(Id::Standard(0x370), &data), 0x48);
    assert_eq!(maker(MakerScheme::HyundaiCrc8, 48, 8).sum(Id::Standard(0x340), &data), 0xDA);
    assert_eq!(maker(MakerScheme::HyundaiSum6, 48, 8).sum(Id::Standard(0x340), &data), 0x65);
    assert_eq!(maker(MakerScheme::HyundaiSum7, 48, 8).sum(Id::Standard(0x340), &[0, 0, 0, 1, 0, 0, 9, 5]), 6);
    // 16 minus the nibbles' sum, modulo 16; its own nibble (bits 60..64 here) counts as 0.
    let nibbles: u64 = [1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7].iter().sum();
    assert_eq!(maker(MakerScheme::HyundaiNibble, 60, 4).sum(ID, &data), (16 - nibbles % 16) % 16);
    let mut own = data;
    own[7] = 0x90;
    assert_eq!(maker(MakerScheme::HyundaiNibble, 60, 4).sum(ID, &own), (16 - nibbles % 16) % 16);
}

#[test]
fn every_scheme_checks_what_it_protects_and_refuses_what_was_spoiled() {
    let all = [
        profile_1(0x4AB, DataIdMode::Both),
        profile_1(0x4AB, DataIdMode::Alternating),
        profile_1(0x4AB, DataIdMode::Low),
        profile_1(0x4AB, DataIdMode::Nibble),
        profile_2(std::array::from_fn(|i| (i * 7) as u8)),
        profile_5(2, 0xBEEF),
        maker(MakerScheme::Toyota, 56, 8),
        maker(MakerScheme::Nissan, 56, 8),
        maker(MakerScheme::Tesla, 48, 8),
        maker(MakerScheme::HyundaiCrc8, 48, 8),
        maker(MakerScheme::HyundaiSum6, 48, 8),
        maker(MakerScheme::HyundaiSum7, 48, 8),
        maker(MakerScheme::HyundaiNibble, 60, 4),
    ];
    for protection in all {
        for seed in 0..50u64 {
            let mut data = (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15)).to_le_bytes();
            protection.protect(ID, &mut data, seed % 15);
            assert!(protection.check(ID, &data, &mut CheckState::default()).good(), "{protection:?}");
            protection.spoil(&mut data);
            let verdict = protection.check(ID, &data, &mut CheckState::default());
            assert_eq!(verdict, Verdict::Wrong, "{protection:?}");
        }
    }
}

#[test]
fn another_message_of_the_same_bytes_is_refused() {
    let data = protected(&profile_1(0x123, DataIdMode::Both), 4, 8);
    for other in [0x122, 0x133, 0x223] {
        let verdict = profile_1(other, DataIdMode::Both).check(ID, &data, &mut CheckState::default());
        assert_eq!(verdict, Verdict::Wrong, "{other:X}");
    }
    let data = protected(&profile_1(0x123, DataIdMode::Nibble), 4, 8);
    let verdict = profile_1(0x223, DataIdMode::Nibble).check(ID, &data, &mut CheckState::default());
    assert_eq!(verdict, Verdict::Wrong, "same low byte, other nibble");
}

#[test]
fn the_counters_steps_are_judged_as_the_profiles_say() {
    let protection = profile_1(0x123, DataIdMode::Both);
    let mut state = CheckState::default();
    let mut judge = |counter| {
        let data = protected(&protection, counter, 8);
        protection.check(ID, &data, &mut state)
    };
    assert_eq!(judge(13), Verdict::Initial);
    assert_eq!(judge(14), Verdict::Ok);
    assert_eq!(judge(0), Verdict::Ok, "after 14 comes 0");
    assert_eq!(judge(0), Verdict::Repeated);
    assert_eq!(judge(2), Verdict::SomeLost);
    assert_eq!(judge(5), Verdict::SomeLost, "a step of 3 is allowed");
    assert_eq!(judge(9), Verdict::WrongSequence, "one of 4 is not");
    assert_eq!(judge(10), Verdict::Ok, "but is started from");
    assert_eq!(judge(9), Verdict::WrongSequence, "backwards");
    assert_eq!(judge(15), Verdict::Wrong, "15 is no counter of profile 1");
}
