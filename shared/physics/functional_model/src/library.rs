//! Blocks that come with the product: `use = "library/NAME.toml"`. Their text is part of the program, so a model
//! needs no files beside it; to change a block, copy it next to the model and use the copy.

/// Name and text of every library block.
pub const BLOCKS: &[(&str, &str)] = &[
    ("library/ball_screw.toml", include_str!("../../../../schemas/models/library/ball_screw.toml")),
    ("library/clutch.toml", include_str!("../../../../schemas/models/library/clutch.toml")),
    ("library/compliance.toml", include_str!("../../../../schemas/models/library/compliance.toml")),
    (
        "library/compliance_rotary.toml",
        include_str!("../../../../schemas/models/library/compliance_rotary.toml"),
    ),
    ("library/damper.toml", include_str!("../../../../schemas/models/library/damper.toml")),
    ("library/end_stop.toml", include_str!("../../../../schemas/models/library/end_stop.toml")),
    ("library/friction.toml", include_str!("../../../../schemas/models/library/friction.toml")),
    ("library/gear.toml", include_str!("../../../../schemas/models/library/gear.toml")),
    ("library/hand_wheel.toml", include_str!("../../../../schemas/models/library/hand_wheel.toml")),
    (
        "library/hydraulic_cylinder.toml",
        include_str!("../../../../schemas/models/library/hydraulic_cylinder.toml"),
    ),
    ("library/hydraulic_pump.toml", include_str!("../../../../schemas/models/library/hydraulic_pump.toml")),
    ("library/hydraulic_valve.toml", include_str!("../../../../schemas/models/library/hydraulic_valve.toml")),
    (
        "library/hydraulic_volume.toml",
        include_str!("../../../../schemas/models/library/hydraulic_volume.toml"),
    ),
    ("library/inertia.toml", include_str!("../../../../schemas/models/library/inertia.toml")),
    ("library/mass.toml", include_str!("../../../../schemas/models/library/mass.toml")),
    ("library/motor.toml", include_str!("../../../../schemas/models/library/motor.toml")),
    ("library/motor_dc.toml", include_str!("../../../../schemas/models/library/motor_dc.toml")),
    ("library/pitman_arm.toml", include_str!("../../../../schemas/models/library/pitman_arm.toml")),
    ("library/rack_pinion.toml", include_str!("../../../../schemas/models/library/rack_pinion.toml")),
    ("library/rack_pinion_map.toml", include_str!("../../../../schemas/models/library/rack_pinion_map.toml")),
    ("library/rotary_damper.toml", include_str!("../../../../schemas/models/library/rotary_damper.toml")),
    ("library/rotary_friction.toml", include_str!("../../../../schemas/models/library/rotary_friction.toml")),
    ("library/sector.toml", include_str!("../../../../schemas/models/library/sector.toml")),
    (
        "library/torque_converter.toml",
        include_str!("../../../../schemas/models/library/torque_converter.toml"),
    ),
    ("library/torque_map.toml", include_str!("../../../../schemas/models/library/torque_map.toml")),
    ("library/torsion_bar.toml", include_str!("../../../../schemas/models/library/torsion_bar.toml")),
    ("library/universal_joint.toml", include_str!("../../../../schemas/models/library/universal_joint.toml")),
];

/// Text of a library block.
pub(crate) fn resolve(name: &str) -> Option<String> {
    BLOCKS.iter().find(|b| b.0 == name).map(|b| b.1.to_string())
}
