//! OpenCRG surfaces against answers computed here from the files' own numbers, and what happens at their edges.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use config::SurfaceFiles;
use config::road::{Friction, Outside, Road as RoadSection, Surface};
use road::{Place, Road, WHEELS};
use std::path::{Path, PathBuf};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

/// Positions of the samples' long sections.
const V: [f64; 7] = [-1.5, -1.25, -1.0, 0.0, 1.0, 1.25, 1.5];

fn reference(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/reference/road").join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "missing reference {}", path.display());
    eprintln!("skipped: reference file road/{name} is missing");
    None
}

/// First channel and elevations of each cross section of a sample (fixed columns of ten characters).
fn rows(path: &Path) -> Vec<(f64, [f64; 7])> {
    let text = std::fs::read_to_string(path).unwrap();
    let data = text.lines().skip_while(|line| !line.starts_with("$$$$")).skip(1);
    data.filter(|line| !line.starts_with("* ") && line.len() >= 80)
        .map(|line| {
            let cell = |k: usize| line[10 * k..10 * k + 10].trim().parse().unwrap_or(f64::NAN);
            (cell(0), std::array::from_fn(|k| cell(k + 1)))
        })
        .collect()
}

fn laid(outside: Outside) -> Surface {
    Surface {
        file: String::new(),
        begin_x_m: 0.0,
        begin_y_m: 0.0,
        begin_height_m: 0.0,
        heading_deg: 0.0,
        height_scale: 1.0,
        outside,
        patch_length_m: 0.01,
        patch_width_m: 0.01,
    }
}

fn section(surface: Option<Surface>) -> RoadSection {
    RoadSection {
        friction: Friction::Split {
            left_scale: 0.3,
            right_scale: 0.9,
            outside_scale: 1.0,
            from_x_m: 10.0,
            to_x_m: 20.0,
        },
        grade_percent: 0.0,
        bank_percent: 0.0,
        crosswind: None,
        surface,
    }
}

fn road(path: &Path, surface: Surface) -> Road {
    let files = SurfaceFiles::read(path).unwrap_or_else(|problems| panic!("{problems}"));
    Road::new(&section(Some(surface)), Some(&files)).unwrap()
}

fn at(x_m: f64, y_m: f64) -> Place {
    Place { x_m, y_m, heading_rad: 0.0 }
}

#[test]
fn grade_bank_and_friction_without_a_surface() {
    let plane = RoadSection { grade_percent: 10.0, bank_percent: -5.0, ..section(None) };
    let mut road = Road::new(&plane, None).unwrap();
    let found = road.contacts(&[at(15.0, 1.0), at(15.0, -1.0), at(5.0, 1.0), at(20.0, 1.0)]);
    assert_eq!(found.map(|c| c.friction), [0.3, 0.9, 1.0, 1.0]);
    assert!((found[0].height_m - (1.5 - 0.05)).abs() < 1e-12 && !found[0].outside);
    assert!(Road::new(&section(Some(laid(Outside::Hold))), None).is_err());
}

#[test]
fn banked_elevations_are_grid_plus_bank_times_v() {
    let Some(path) = reference("handmade_banked.crg") else { return };
    let road = road(&path, laid(Outside::Hold));
    let rows = rows(&path);
    assert!(rows.len() >= 20);
    for (i, (bank, z)) in rows.iter().enumerate() {
        for (v, z) in V.iter().zip(z) {
            let (height, uv) = road.at(i as f64, *v);
            let uv = uv.unwrap();
            assert!((uv[0] - i as f64).abs() < 1e-9 && (uv[1] - v).abs() < 1e-9, "{uv:?}");
            // Data are single precision.
            assert!((height - (z + bank * v)).abs() < 2e-8, "({i}, {v}): {height} is not {z} + {bank} v");
        }
    }
    // Between nodes: bilinear.
    let corner = |i: usize, j: usize| rows[i].1[j];
    let mean = 0.25 * (corner(6, 2) + corner(6, 3) + corner(7, 2) + corner(7, 3));
    let bank = 0.5 * (rows[6].0 + rows[7].0);
    assert!((road.at(6.5, -0.5).0 - (mean - 0.5 * bank)).abs() < 2e-8);
}

#[test]
fn sloped_elevations_are_grid_plus_the_sum_of_slopes() {
    let Some(path) = reference("handmade_sloped.crg") else { return };
    let road = road(&path, laid(Outside::Hold));
    let mut climbed = 0.0;
    for (i, (slope, z)) in rows(&path).iter().enumerate() {
        if i > 0 {
            climbed += slope * 1.0;
        }
        for (v, z) in V.iter().zip(z) {
            let height = road.at(i as f64, *v).0;
            assert!((height - (z + climbed)).abs() < 1e-6, "({i}, {v}): {height} is not {z} + {climbed}");
        }
    }
    assert!(climbed > 0.5);
}

#[test]
fn a_curved_line_is_followed_and_can_be_laid_anywhere() {
    let Some(path) = reference("handmade_arc.crg") else { return };
    let placed = Surface {
        begin_x_m: 100.0,
        begin_y_m: -20.0,
        begin_height_m: 0.5,
        heading_deg: 90.0,
        height_scale: 2.0,
        ..laid(Outside::Hold)
    };
    let (plain, moved) = (road(&path, laid(Outside::Hold)), road(&path, placed));
    let rows = rows(&path);
    // The line begins at the origin along x (first segment's heading 0), 4 m a segment.
    let (mut x, mut y) = (0.0_f64, 0.0_f64);
    let z0 = rows[0].1[3];
    for (i, (phi, z)) in rows.iter().enumerate() {
        if i > 0 {
            x += 4.0 * phi.cos();
            y += 4.0 * phi.sin();
        }
        let (height, uv) = plain.at(x, y);
        let uv = uv.unwrap();
        assert!((uv[0] - 4.0 * i as f64).abs() < 1e-6 && uv[1].abs() < 1e-6, "node {i}: {uv:?}");
        assert!((height - (z[3] - z0)).abs() < 1e-6, "node {i}: {height}");
        // Turned by 90 degrees: (x, y) goes to (-y, x).
        let (height, uv) = moved.at(100.0 - y, -20.0 + x);
        assert!((uv.unwrap()[0] - 4.0 * i as f64).abs() < 1e-6);
        assert!((height - (0.5 + 2.0 * (z[3] - z0))).abs() < 1e-6, "node {i}: {height}");
    }
}

#[test]
fn beyond_the_grid_it_is_held_or_zero_and_flagged() {
    let Some(path) = reference("handmade_straight.crg") else { return };
    let places = [at(10.0, 0.3), at(30.0, 1.5), at(7.0, 2.5), at(-3.0, 0.0)];
    let mut hold = road(&path, laid(Outside::Hold));
    let edges = [hold.at(10.0, 0.3).0, hold.at(22.0, 1.5).0, hold.at(7.0, 1.5).0, hold.at(0.0, 0.0).0];
    let found = hold.contacts(&places);
    assert_eq!(found.map(|c| c.outside), [false, true, true, true]);
    for (contact, edge) in found.iter().zip(edges) {
        assert!((contact.height_m - edge).abs() < 1e-3, "{contact:?} {edge}");
    }
    assert!(edges[2].abs() > 1e-3, "the test needs an edge that is not flat");
    let found = road(&path, laid(Outside::Zero)).contacts(&places);
    assert_eq!(found.map(|c| c.outside), [false, true, true, true]);
    assert!(found[1..].iter().all(|c| c.height_m == 0.0 && c.slope_x == 0.0));
    // Friction is laid over it.
    assert_eq!(found[0].friction, 0.3);
}

#[test]
fn the_patch_gives_the_plane_of_a_plane_and_smooths_what_is_shorter() {
    // 5 m by 4 m, slopes 0.02 along u and -0.03 along v, in steps of 0.5 m.
    let mut text = String::from(
        "$ROAD_CRG\nREFERENCE_LINE_INCREMENT = 0.5\nLONG_SECTION_V_RIGHT = -2.0\nLONG_SECTION_V_LEFT = 2.0\n\
         LONG_SECTION_V_INCREMENT = 1.0\n$\n$KD_Definition\n#:LRFI\n",
    );
    (1..=5).for_each(|k| text.push_str(&format!("D:long section {k},m\n")));
    text.push_str("$\n$$$$\n");
    for i in 0..=10 {
        for j in 0..5 {
            let z = 0.02 * 0.5 * f64::from(i) - 0.03 * f64::from(j - 2);
            text.push_str(&format!("{z:10.7}"));
        }
        text.push('\n');
    }
    let folder = std::env::temp_dir().join(format!("kingpin-road-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("plane.crg");
    std::fs::write(&path, text).unwrap();
    let surface = Surface { patch_length_m: 0.2, patch_width_m: 0.2, ..laid(Outside::Hold) };
    let mut plane = road(&path, surface.clone());
    std::fs::remove_dir_all(&folder).unwrap();
    for heading_rad in [0.0, 0.7, -2.0] {
        let found = plane.contacts(&[Place { x_m: 2.3, y_m: -0.4, heading_rad }; WHEELS]);
        for contact in found {
            assert!((contact.height_m - (0.02 * 2.3 + 0.03 * 0.4)).abs() < 1e-6, "{contact:?}");
            assert!((contact.slope_x - 0.02).abs() < 1e-5 && (contact.slope_y + 0.03).abs() < 1e-5);
        }
    }
    let Some(path) = reference("belgian_block.crg") else { return };
    let spread = |length: f64| {
        let surface = Surface { patch_length_m: length, patch_width_m: length, ..laid(Outside::Hold) };
        let mut road = road(&path, surface);
        let heights: Vec<f64> =
            (100..900).map(|i| road.contacts(&[at(0.01 * f64::from(i), 0.2); WHEELS])[2].height_m).collect();
        let mean = heights.iter().sum::<f64>() / heights.len() as f64;
        (heights.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / heights.len() as f64).sqrt()
    };
    // The setts are about 0.2 m long.
    let (point, patch) = (spread(0.01), spread(0.35));
    assert!(point > 1e-3 && patch < 0.92 * point, "{point} {patch}");
}

#[test]
fn a_step_on_a_surface_does_not_allocate_and_searching_on_matches_searching_anew() {
    let Some(path) = reference("belgian_block.crg") else { return };
    let mut road = road(&path, laid(Outside::Hold));
    let mut last = None;
    assert_no_alloc(|| {
        for n in 0..2000 {
            let x = -1.0 + 0.006 * f64::from(n);
            last = Some(road.contacts(&[at(x + 2.7, 0.7), at(x + 2.7, -0.7), at(x, 0.7), at(x, -0.7)]));
        }
    });
    assert_eq!(violation_count(), 0);
    let x = -1.0 + 0.006 * 1999.0;
    let mut anew = self::road(&path, laid(Outside::Hold));
    let again = anew.contacts(&[at(x + 2.7, 0.7), at(x + 2.7, -0.7), at(x, 0.7), at(x, -0.7)]);
    assert_eq!(last.unwrap(), again);
}

#[test]
fn files_that_cannot_be_used_say_why() {
    let told = |name: &str| reference(name).map(|path| SurfaceFiles::read(&path).unwrap_err().to_string());
    for name in ["fileref.crg", "testOptionBorderMode.crg"] {
        let Some(told) = told(name) else { return };
        assert!(told.contains(name) && told.contains(".crg"), "{told}");
        assert!(told.contains("No such file"), "{told}");
    }
    let Some(path) = reference("README.md") else { return };
    assert!(SurfaceFiles::read(&path).unwrap_err().to_string().contains("OpenCRG"));
    assert!(SurfaceFiles::read(Path::new("nowhere.crg")).unwrap_err().to_string().contains("nowhere.crg"));
    // Every other sample loads.
    for name in [
        "belgian_block",
        "handmade_arc",
        "handmade_banked",
        "handmade_circle",
        "handmade_curved",
        "handmade_curved_banked_sloped",
        "handmade_curved_minimalist",
        "handmade_platform",
        "handmade_sloped",
        "handmade_sloped_opts",
        "handmade_straight",
        "handmade_straight_double",
        "handmade_straight_minimalist",
        "handmade_vtest",
    ] {
        let Some(path) = reference(&format!("{name}.crg")) else { return };
        if let Err(problems) = SurfaceFiles::read(&path) {
            panic!("{problems}");
        }
    }
}
