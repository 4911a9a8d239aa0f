//! The numbers of a `.tir` property file: one list makes the parameter struct, the reader's key table and the
//! fallbacks.
//!
//! Key names are those of MF-Tyre/MF-Swift 5.2, 6.1, 6.2 and PAC2002. `Must` keys are the pure-slip core and the
//! dimensions, without which no version is defined. `Or(value)` keys may be absent; the value is then the one
//! `mfeval` 4.0 (M. Furlan, after the TNO tool) takes, so that incomplete files give the same forces there and
//! here. What was taken is listed by `TyreInfo::substituted`, never silently. (The Mx coefficients fall back to
//! zero; the tool's non-zero values there multiply zeros.)

/// Dimension of a number, for conversion from the units that the file's `[UNITS]` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dimension {
    None,
    Length,
    PerLength,
    PerLengthSquared,
    Force,
    Torque,
    Mass,
    Angle,
    Speed,
    Pressure,
    Stiffness,
    Damping,
}

/// Whether a file may leave the key out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Need {
    /// Its absence is an error.
    Must,
    /// Taken (and reported) when absent.
    Or(f64),
}

/// One key of the list.
pub(crate) struct Key {
    pub name: &'static str,
    pub dimension: Dimension,
    pub need: Need,
    pub set: fn(&mut Parameters, f64),
}

macro_rules! parameters {
    ($($field:ident $name:ident $dimension:ident $need:ident $(($fallback:expr))?;)*) => {
        /// Every number the model reads, in SI.
        #[derive(Debug, Clone, Default)]
        pub(crate) struct Parameters {
            $(pub $field: f64,)*
        }

        /// The key table, in the order of the file format.
        pub(crate) static KEYS: &[Key] = &[$(
            Key {
                name: stringify!($name),
                dimension: Dimension::$dimension,
                need: Need::$need $(($fallback))?,
                set: |p, v| p.$field = v,
            },
        )*];
    };
}

parameters! {
    // [MODEL]
    longvl LONGVL Speed Or(16.7);
    vxlow VXLOW Speed Or(1.0);
    // [DIMENSION]
    unloaded_radius UNLOADED_RADIUS Length Must;
    width WIDTH Length Must;
    aspect_ratio ASPECT_RATIO None Must;
    rim_radius RIM_RADIUS Length Must;
    rim_width RIM_WIDTH Length Or(0.152);
    // [OPERATING_CONDITIONS]
    inflpres INFLPRES Pressure Or(220e3);
    nompres NOMPRES Pressure Or(220e3);
    // [VERTICAL]
    fnomin FNOMIN Force Must;
    vertical_stiffness VERTICAL_STIFFNESS Stiffness Must;
    vertical_damping VERTICAL_DAMPING Damping Or(50.0);
    breff BREFF None Or(8.4);
    dreff DREFF None Or(0.27);
    freff FREFF None Or(0.07);
    q_re0 Q_RE0 None Or(1.0);
    q_v1 Q_V1 None Or(0.0);
    q_v2 Q_V2 None Or(0.0);
    q_fz2 Q_FZ2 None Or(1e-4);
    q_fcx Q_FCX None Or(0.0);
    q_fcy Q_FCY None Or(0.0);
    q_fcy2 Q_FCY2 None Or(0.0);
    q_cam1 Q_CAM1 PerLength Or(0.0);
    q_cam2 Q_CAM2 PerLengthSquared Or(0.0);
    q_cam3 Q_CAM3 None Or(0.0);
    q_fys1 Q_FYS1 Force Or(0.0);
    q_fys2 Q_FYS2 Force Or(0.0);
    q_fys3 Q_FYS3 Force Or(0.0);
    pfz1 PFZ1 None Or(0.0);
    bottom_offst BOTTOM_OFFST Length Or(0.01);
    bottom_stiff BOTTOM_STIFF Stiffness Or(2e6);
    // [STRUCTURAL]
    longitudinal_stiffness LONGITUDINAL_STIFFNESS Stiffness Or(300e3);
    lateral_stiffness LATERAL_STIFFNESS Stiffness Or(100e3);
    yaw_stiffness YAW_STIFFNESS Torque Or(5000.0);
    pcfx1 PCFX1 None Or(0.0);
    pcfx2 PCFX2 None Or(0.0);
    pcfx3 PCFX3 None Or(0.0);
    pcfy1 PCFY1 None Or(0.0);
    pcfy2 PCFY2 None Or(0.0);
    pcfy3 PCFY3 None Or(0.0);
    pcmz1 PCMZ1 None Or(0.0);
    // [CONTACT_PATCH]
    q_ra1 Q_RA1 None Or(0.5);
    q_ra2 Q_RA2 None Or(1.0);
    q_rb1 Q_RB1 None Or(1.0);
    q_rb2 Q_RB2 None Or(-1.0);
    q_a1 Q_A1 None Or(0.0);
    q_a2 Q_A2 None Or(0.0);
    // Ranges
    presmin PRESMIN Pressure Or(10e3);
    presmax PRESMAX Pressure Or(1e6);
    fzmin FZMIN Force Or(100.0);
    fzmax FZMAX Force Or(10e3);
    kpumin KPUMIN None Or(-1.5);
    kpumax KPUMAX None Or(1.5);
    alpmin ALPMIN Angle Or(-1.5);
    alpmax ALPMAX Angle Or(1.5);
    cammin CAMMIN Angle Or(-0.175);
    cammax CAMMAX Angle Or(0.175);
    // [SCALING_COEFFICIENTS]
    lfzo LFZO None Or(1.0);
    lcx LCX None Or(1.0);
    lmux LMUX None Or(1.0);
    lex LEX None Or(1.0);
    lkx LKX None Or(1.0);
    lhx LHX None Or(1.0);
    lvx LVX None Or(1.0);
    lgax LGAX None Or(1.0);
    lcy LCY None Or(1.0);
    lmuy LMUY None Or(1.0);
    ley LEY None Or(1.0);
    lky LKY None Or(1.0);
    lhy LHY None Or(1.0);
    lvy LVY None Or(1.0);
    lgay LGAY None Or(1.0);
    lkyc LKYC None Or(1.0);
    lkzc LKZC None Or(1.0);
    ltr LTR None Or(1.0);
    lres LRES None Or(1.0);
    lgaz LGAZ None Or(1.0);
    lxal LXAL None Or(1.0);
    lyka LYKA None Or(1.0);
    lvyka LVYKA None Or(1.0);
    ls LS None Or(1.0);
    lsgkp LSGKP None Or(1.0);
    lsgal LSGAL None Or(1.0);
    lgyr LGYR None Or(1.0);
    lvmx LVMX None Or(1.0);
    lmx LMX None Or(1.0);
    lmy LMY None Or(1.0);
    lmp LMP None Or(1.0);
    // [LONGITUDINAL_COEFFICIENTS]
    pcx1 PCX1 None Must;
    pdx1 PDX1 None Must;
    pdx2 PDX2 None Must;
    pdx3 PDX3 None Or(0.0);
    pex1 PEX1 None Must;
    pex2 PEX2 None Must;
    pex3 PEX3 None Must;
    pex4 PEX4 None Must;
    pkx1 PKX1 None Must;
    pkx2 PKX2 None Must;
    pkx3 PKX3 None Must;
    phx1 PHX1 None Must;
    phx2 PHX2 None Must;
    pvx1 PVX1 None Must;
    pvx2 PVX2 None Must;
    ppx1 PPX1 None Or(0.0);
    ppx2 PPX2 None Or(0.0);
    ppx3 PPX3 None Or(0.0);
    ppx4 PPX4 None Or(0.0);
    rbx1 RBX1 None Or(20.0);
    rbx2 RBX2 None Or(15.0);
    rbx3 RBX3 None Or(0.0);
    rcx1 RCX1 None Or(1.0);
    rex1 REX1 None Or(0.0);
    rex2 REX2 None Or(0.0);
    rhx1 RHX1 None Or(0.0);
    ptx1 PTX1 None Or(0.0);
    ptx2 PTX2 None Or(0.0);
    ptx3 PTX3 None Or(0.0);
    // [OVERTURNING_COEFFICIENTS]
    qsx1 QSX1 None Or(0.0);
    qsx2 QSX2 None Or(0.0);
    qsx3 QSX3 None Or(0.0);
    qsx4 QSX4 None Or(0.0);
    qsx5 QSX5 None Or(0.0);
    qsx6 QSX6 None Or(0.0);
    qsx7 QSX7 None Or(0.0);
    qsx8 QSX8 None Or(0.0);
    qsx9 QSX9 None Or(0.0);
    qsx10 QSX10 None Or(0.0);
    qsx11 QSX11 None Or(0.0);
    qsx12 QSX12 None Or(0.0);
    qsx13 QSX13 None Or(0.0);
    qsx14 QSX14 None Or(0.0);
    ppmx1 PPMX1 None Or(0.0);
    // [LATERAL_COEFFICIENTS]
    pcy1 PCY1 None Must;
    pdy1 PDY1 None Must;
    pdy2 PDY2 None Must;
    pdy3 PDY3 None Must;
    pey1 PEY1 None Must;
    pey2 PEY2 None Must;
    pey3 PEY3 None Must;
    pey4 PEY4 None Must;
    pey5 PEY5 None Or(0.0);
    pky1 PKY1 None Must;
    pky2 PKY2 None Must;
    pky3 PKY3 None Must;
    pky4 PKY4 None Or(2.0);
    pky5 PKY5 None Or(0.0);
    pky6 PKY6 None Or(-1.0);
    pky7 PKY7 None Or(0.0);
    phy1 PHY1 None Must;
    phy2 PHY2 None Must;
    phy3 PHY3 None Or(0.0);
    pvy1 PVY1 None Must;
    pvy2 PVY2 None Must;
    pvy3 PVY3 None Must;
    pvy4 PVY4 None Must;
    ppy1 PPY1 None Or(0.0);
    ppy2 PPY2 None Or(0.0);
    ppy3 PPY3 None Or(0.0);
    ppy4 PPY4 None Or(0.0);
    ppy5 PPY5 None Or(0.0);
    rby1 RBY1 None Or(10.0);
    rby2 RBY2 None Or(10.0);
    rby3 RBY3 None Or(0.0);
    rby4 RBY4 None Or(0.0);
    rcy1 RCY1 None Or(1.0);
    rey1 REY1 None Or(0.0);
    rey2 REY2 None Or(0.0);
    rhy1 RHY1 None Or(0.0);
    rhy2 RHY2 None Or(0.0);
    rvy1 RVY1 None Or(0.0);
    rvy2 RVY2 None Or(0.0);
    rvy3 RVY3 None Or(0.0);
    rvy4 RVY4 None Or(20.0);
    rvy5 RVY5 None Or(2.0);
    rvy6 RVY6 None Or(10.0);
    pty1 PTY1 None Or(0.0);
    pty2 PTY2 None Or(0.0);
    // [ROLLING_COEFFICIENTS]
    qsy1 QSY1 None Or(0.01);
    qsy2 QSY2 None Or(0.0);
    qsy3 QSY3 None Or(4e-4);
    qsy4 QSY4 None Or(4e-5);
    qsy5 QSY5 None Or(0.0);
    qsy6 QSY6 None Or(0.0);
    qsy7 QSY7 None Or(0.85);
    qsy8 QSY8 None Or(-0.4);
    // [ALIGNING_COEFFICIENTS]
    qbz1 QBZ1 None Must;
    qbz2 QBZ2 None Must;
    qbz3 QBZ3 None Must;
    qbz4 QBZ4 None Must;
    qbz5 QBZ5 None Must;
    qbz9 QBZ9 None Must;
    qbz10 QBZ10 None Or(0.0);
    qcz1 QCZ1 None Must;
    qdz1 QDZ1 None Must;
    qdz2 QDZ2 None Must;
    qdz3 QDZ3 None Must;
    qdz4 QDZ4 None Must;
    qdz6 QDZ6 None Must;
    qdz7 QDZ7 None Must;
    qdz8 QDZ8 None Must;
    qdz9 QDZ9 None Must;
    qdz10 QDZ10 None Or(0.0);
    qdz11 QDZ11 None Or(0.0);
    qez1 QEZ1 None Must;
    qez2 QEZ2 None Must;
    qez3 QEZ3 None Must;
    qez4 QEZ4 None Must;
    qez5 QEZ5 None Must;
    qhz1 QHZ1 None Must;
    qhz2 QHZ2 None Must;
    qhz3 QHZ3 None Must;
    qhz4 QHZ4 None Must;
    ppz1 PPZ1 None Or(0.0);
    ppz2 PPZ2 None Or(0.0);
    ssz1 SSZ1 None Or(0.0);
    ssz2 SSZ2 None Or(0.0);
    ssz3 SSZ3 None Or(0.0);
    ssz4 SSZ4 None Or(0.0);
    qtz1 QTZ1 None Or(0.0);
    mbelt MBELT Mass Or(0.0);
    // [TURNSLIP_COEFFICIENTS]
    pdxp1 PDXP1 None Or(0.4);
    pdxp2 PDXP2 None Or(0.0);
    pdxp3 PDXP3 None Or(0.0);
    pkyp1 PKYP1 None Or(1.0);
    pdyp1 PDYP1 None Or(0.4);
    pdyp2 PDYP2 None Or(0.0);
    pdyp3 PDYP3 None Or(0.0);
    pdyp4 PDYP4 None Or(0.0);
    phyp1 PHYP1 None Or(1.0);
    phyp2 PHYP2 None Or(0.15);
    phyp3 PHYP3 None Or(0.0);
    phyp4 PHYP4 None Or(-4.0);
    pecp1 PECP1 None Or(0.5);
    pecp2 PECP2 None Or(0.0);
    qdtp1 QDTP1 None Or(10.0);
    qcrp1 QCRP1 None Or(0.2);
    qcrp2 QCRP2 None Or(0.1);
    qbrp1 QBRP1 None Or(0.1);
    qdrp1 QDRP1 None Or(1.0);
}

/// Keys of the known formats that this model does not use: accepted, their values kept from no one.
pub(crate) static UNUSED: &[&str] = &[
    "FILE_TYPE",
    "FILE_VERSION",
    "FILE_FORMAT",
    "COMMENTS",
    "COMMENT",
    "TIRE_VERSION",
    "PROPERTY_FILE_FORMAT",
    "FITTYP",
    "FUNCTION_NAME",
    "USER_SUB_ID",
    "N_TIRE_STATES",
    "USE_MODE",
    "TYRESIDE",
    "MESSAGES",
    "CONTACT_MODEL",
    "ROAD_INCREMENT",
    "ROAD_DIRECTION",
    "HMAX_LOCAL",
    "TIME_SWITCH_INTEG",
    "SWITCH_INTEG",
    "SWITCH_INTEG_FZ",
    "BELT_DYNAMICS",
    "DYNAMIC_MODE",
    "ROAD_CONTACT",
    "TYRE_SIDE",
    "LENGTH",
    "FORCE",
    "ANGLE",
    "MASS",
    "TIME",
    "PRESSURE",
    "TEMPERATURE",
    "IXX",
    "IYY",
    "BELT_MASS",
    "BELT_IXX",
    "BELT_IYY",
    "GRAVITY",
    "M_A",
    "I_AY",
    "I_AXZ",
    "M_B",
    "I_BY",
    "I_BXZ",
    "I_AX",
    "I_AZ",
    "I_BX",
    "I_BZ",
    "M_R",
    "MC_CONTOUR_A",
    "MC_CONTOUR_B",
    "Q_CAM",
    "Q_FZ1",
    "Q_FZ3",
    "Q_FCG1",
    "Q_FYS",
    "Q_RE",
    "QFZ1",
    "QFZ2",
    "QFZ3",
    "QPFZ1",
    "QV1",
    "QV2",
    "QFCX1",
    "QFCY1",
    "QFCG1",
    "BOTTOM_TRNSF",
    "BOTTOM_OFFSET",
    "FREQ_LONG",
    "FREQ_LAT",
    "FREQ_YAW",
    "FREQ_WINDUP",
    "DAMP_LONG",
    "DAMP_LAT",
    "DAMP_YAW",
    "DAMP_WINDUP",
    "DAMP_RESIDUAL",
    "DAMP_VLOW",
    "Q_BVX",
    "Q_BVT",
    "C_BX0",
    "C_RX",
    "C_BT0",
    "C_BY",
    "C_RY",
    "C_BGAM",
    "C_RP",
    "K_BX",
    "K_BT",
    "K_BY",
    "K_BGAM",
    "ELLIPS_SHIFT",
    "ELLIPS_LENGTH",
    "ELLIPS_HEIGHT",
    "ELLIPS_ORDER",
    "ELLIPS_MAX_STEP",
    "ELLIPS_NWIDTH",
    "ELLIPS_NLENGTH",
    "ENV_C1",
    "ENV_C2",
    "Q_CONTACT",
    "Q_A3",
    "Q_LBF",
    "Q_LOS1",
    "Q_LIMP1",
    "QBZ6",
    "RBY5",
    "PKY8",
    "PDX4",
    "QDZ5",
    "LKC",
    "LCC",
    "LKYG",
    "LMUV",
    "LSGKP0",
    "LMR",
    "LAMU",
    "LCZ",
    "LFZ0",
    "ROAD_FRICTION",
    "TYRE_FRICTION",
    "PHYP0",
    "QTZ2",
    "CONTACT_LENGTH",
    "N_CONTACT",
];
