//! Every field on offer: names, formulas, parameters, sources, and an instance of each in the default scene.
//!
//! One table serves the list that users read and the tests that every field must pass, so that no field can be listed
//! untested. The default scene is a channel 100 um deep (z from -80 to 20 um) seen at 0.645 um per px with 5 ms from frame to
//! frame: 1290 um/s are 10 px a frame.

use crate::error::Result;
use crate::field::VelocityField;
use crate::fields::*;
use crate::params::Parameter;
use crate::region::Axis;

/// A field on offer.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Its name in scenarios.
    pub name: &'static str,
    /// The velocity in one line.
    pub formula: &'static str,
    /// What can be set. A composition takes its inner field or fields besides.
    pub parameters: &'static [Parameter],
    /// Where the formula comes from.
    pub source: &'static str,
    /// A plane that shows it well.
    pub plane: Plane,
    /// The field of default parameters; of a composition an example.
    pub make: Make,
    /// The same with other parameters, where they change the formula: for tests, and as examples.
    pub variants: &'static [(&'static str, Make)],
}

/// Makes a field.
pub type Make = fn() -> Result<Box<dyn VelocityField>>;

/// A plane of the default scene, to draw a field in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// The axis across it.
    pub across: Axis,
    /// Where it stands on that axis, um.
    pub at_um: f64,
}

impl Plane {
    /// The image plane in the middle of the channel.
    pub const XY: Plane = Plane { across: Axis::Z, at_um: -30.0 };
    /// Along the channel and over its depth.
    pub const XZ: Plane = Plane { across: Axis::Y, at_um: 0.0 };
    /// The cross-section of the channel.
    pub const YZ: Plane = Plane { across: Axis::X, at_um: 0.0 };
}

/// The field of a name.
pub fn find(name: &str) -> Option<&'static Entry> {
    ENTRIES.iter().find(|entry| entry.name == name)
}

fn boxed<F: VelocityField + 'static>(field: Result<F>) -> Result<Box<dyn VelocityField>> {
    Ok(Box::new(field?))
}

/// A grid that samples a vortex.
fn grid(interpolation: Interpolation) -> Result<Box<dyn VelocityField>> {
    let grid = sampled(vortex(0.0)?.as_ref())?;
    boxed(Gridded::new(&grid, interpolation, [false; 3]))
}

/// The channel of the default scene, as a part of compositions.
fn channel() -> Result<Box<dyn VelocityField>> {
    boxed(Poiseuille::from_params(&PoiseuilleParams::default()))
}

/// A vortex off the middle, as a part of compositions.
fn vortex(viscosity_um2_s: f64) -> Result<Box<dyn VelocityField>> {
    let centre_um = [20.0, -10.0];
    boxed(LambOseen::from_params(&LambOseenParams { viscosity_um2_s, centre_um, ..Default::default() }))
}

/// All of them.
pub const ENTRIES: &[Entry] = &[
    Entry {
        name: "uniform",
        formula: "u = U",
        parameters: UniformParams::PARAMETERS,
        source: "any textbook",
        plane: Plane::XY,
        make: || boxed(Linear::from_uniform(&UniformParams::default())),
        variants: &[],
    },
    Entry {
        name: "shear",
        formula: "u = g (s - s0), along one axis and growing along another",
        parameters: ShearParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 2.3",
        plane: Plane::XZ,
        make: || boxed(Linear::from_shear(&ShearParams::default())),
        variants: &[("xy", || {
            boxed(Linear::from_shear(&ShearParams {
                across: Axis::Y,
                centre_um: Some([0.0; 3]),
                ..Default::default()
            }))
        })],
    },
    Entry {
        name: "rotation",
        formula: "u = omega x (x - c)",
        parameters: RotationParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 2.3",
        plane: Plane::XY,
        make: || boxed(Linear::from_rotation(&RotationParams::default())),
        variants: &[("oblique", || {
            boxed(Linear::from_rotation(&RotationParams {
                omega_rad_s: [1.0, 2.0, 8.0],
                centre_um: Some([20.0, -10.0, -30.0]),
            }))
        })],
    },
    Entry {
        name: "strain",
        formula: "planar: u = e (x, -y, 0); uniaxial along x: u = e (x, -y/2, -z/2)",
        parameters: StrainParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 2.3",
        plane: Plane::XY,
        make: || boxed(Linear::from_strain(&StrainParams::default())),
        variants: &[("uniaxial", || {
            boxed(Linear::from_strain(&StrainParams { kind: Strain::UniaxialZ, ..Default::default() }))
        })],
    },
    Entry {
        name: "dilatation",
        formula: "u = e (x - c)",
        parameters: DilatationParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 2.3",
        plane: Plane::XY,
        make: || boxed(Linear::from_dilatation(&DilatationParams::default())),
        variants: &[],
    },
    Entry {
        name: "linear",
        formula: "u = U + A (x - c)",
        parameters: LinearParams::PARAMETERS,
        source: "Moler & Van Loan, SIAM Review 45 (2003) 3, for its trajectories",
        plane: Plane::XY,
        make: || boxed(Linear::from_params(&LinearParams::default())),
        variants: &[("oblique", || {
            boxed(Linear::from_params(&LinearParams {
                velocity_um_s: [300.0, 0.0, 50.0],
                gradient_per_s: [[3.0, -4.0, 0.3], [1.0, -5.0, 2.0], [-2.0, 0.5, 2.0]],
                ..Default::default()
            }))
        })],
    },
    Entry {
        name: "poiseuille",
        formula: "u = 4 U s (1 - s), s = (z - floor) / depth",
        parameters: PoiseuilleParams::PARAMETERS,
        source: "Landau & Lifshitz, Fluid Mechanics, 17",
        plane: Plane::XZ,
        make: || boxed(Poiseuille::from_params(&PoiseuilleParams::default())),
        variants: &[("diagonal", || {
            boxed(Poiseuille::from_params(&PoiseuilleParams { direction_rad: 0.3, ..Default::default() }))
        })],
    },
    Entry {
        name: "couette_poiseuille",
        formula: "u = V s + 4 U s (1 - s), s = (z - floor) / depth",
        parameters: CouettePoiseuilleParams::PARAMETERS,
        source: "Landau & Lifshitz, Fluid Mechanics, 17",
        plane: Plane::XZ,
        make: || boxed(CouettePoiseuille::new(&CouettePoiseuilleParams::default())),
        variants: &[],
    },
    Entry {
        name: "duct",
        formula: "u = Boussinesq series of a rectangular duct along x",
        parameters: DuctParams::PARAMETERS,
        source: "Bruus, Theoretical Microfluidics, 3.4.6",
        plane: Plane::YZ,
        make: || boxed(Duct::new(&DuctParams::default())),
        variants: &[("deep", || boxed(Duct::new(&DuctParams { width_um: 60.0, ..Default::default() })))],
    },
    Entry {
        name: "tube",
        formula: "u = U (1 - r^2 / R^2) along x",
        parameters: TubeParams::PARAMETERS,
        source: "Landau & Lifshitz, Fluid Mechanics, 17",
        plane: Plane::YZ,
        make: || boxed(Tube::new(&TubeParams::default())),
        variants: &[],
    },
    Entry {
        name: "womersley",
        formula: "u = Us P0 + Re(A P e^(iwt)), plane P = (1 - cosh(L eta)/cosh L) / (1 - tanh(L)/L), L = sqrt(i) Wo; tube with J0",
        parameters: WomersleyParams::PARAMETERS,
        source: "Womersley, J. Physiol. 127 (1955) 553",
        plane: Plane::XZ,
        make: || boxed(Womersley::new(&WomersleyParams::default())),
        variants: &[
            ("plane Wo 5", || {
                boxed(Womersley::new(&WomersleyParams { viscosity_um2_s: 12_566.0, ..Default::default() }))
            }),
            ("tube", || {
                boxed(Womersley::new(&WomersleyParams {
                    cross_section: CrossSection::Tube,
                    viscosity_um2_s: 12_566.0,
                    ..Default::default()
                }))
            }),
            ("tube Wo 40", || {
                boxed(Womersley::new(&WomersleyParams {
                    cross_section: CrossSection::Tube,
                    viscosity_um2_s: 197.0,
                    ..Default::default()
                }))
            }),
        ],
    },
    Entry {
        name: "electro_osmotic",
        formula: "u = U (1 - cosh(z/l) / cosh(h/l)), closed: minus the parabola of the same mean",
        parameters: ElectroOsmoticParams::PARAMETERS,
        source: "Bruus, Theoretical Microfluidics, 9.2",
        plane: Plane::XZ,
        make: || boxed(ElectroOsmotic::new(&ElectroOsmoticParams::default())),
        variants: &[
            ("closed", || {
                boxed(ElectroOsmotic::new(&ElectroOsmoticParams { closed: true, ..Default::default() }))
            }),
            ("thick layer", || {
                boxed(ElectroOsmotic::new(&ElectroOsmoticParams {
                    debye_length_um: 5.0,
                    closed: true,
                    ..Default::default()
                }))
            }),
        ],
    },
    Entry {
        name: "hele_shaw",
        formula: "u = 6 s (1 - s) U (1 - a^2 (X^2 - Y^2)/r^4, -2 a^2 X Y/r^4, 0)",
        parameters: HeleShawParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 4.8",
        plane: Plane::XY,
        make: || boxed(HeleShaw::new(&HeleShawParams::default())),
        variants: &[],
    },
    Entry {
        name: "rankine",
        formula: "v = V r/R inside, V R/r outside",
        parameters: RankineParams::PARAMETERS,
        source: "Saffman, Vortex Dynamics, 2.3",
        plane: Plane::XY,
        make: || boxed(Rankine::new(&RankineParams::default())),
        variants: &[],
    },
    Entry {
        name: "lamb_oseen",
        formula: "v = G/(2 pi r) (1 - e^(-r^2/s)), s = rc^2 + 4 nu t",
        parameters: LambOseenParams::PARAMETERS,
        source: "Saffman, Vortex Dynamics, 13.1",
        plane: Plane::XY,
        make: || boxed(LambOseen::from_params(&LambOseenParams::default())),
        variants: &[
            ("slow", || {
                boxed(LambOseen::from_params(&LambOseenParams {
                    viscosity_um2_s: 1e3,
                    centre_um: [20.0, -10.0],
                    ..Default::default()
                }))
            }),
            ("in water", || {
                boxed(LambOseen::from_params(&LambOseenParams {
                    viscosity_um2_s: 1e6,
                    centre_um: [20.0, -10.0],
                    ..Default::default()
                }))
            }),
        ],
    },
    Entry {
        name: "burgers",
        formula: "u_r = -a r/2, u_z = a z, v = G/(2 pi r) (1 - e^(-r^2/rc^2))",
        parameters: BurgersParams::PARAMETERS,
        source: "Burgers, Adv. Appl. Mech. 1 (1948) 171",
        plane: Plane::XY,
        make: || boxed(Burgers::new(&BurgersParams::default())),
        variants: &[],
    },
    Entry {
        name: "taylor_green",
        formula: "u = U sin kx cos ky e^(-2 nu k^2 t), v = -U cos kx sin ky e^(-2 nu k^2 t)",
        parameters: TaylorGreenParams::PARAMETERS,
        source: "Taylor & Green, Proc. R. Soc. A 158 (1937) 499",
        plane: Plane::XY,
        make: || boxed(TaylorGreen::new(&TaylorGreenParams::default())),
        variants: &[("steady", || {
            boxed(TaylorGreen::new(&TaylorGreenParams { viscosity_um2_s: 0.0, ..Default::default() }))
        })],
    },
    Entry {
        name: "cellular",
        formula: "psi = (U/ky) sin kx X sin ky y, X = x + b sin wt",
        parameters: CellularParams::PARAMETERS,
        source: "Solomon & Gollub, Phys. Rev. A 38 (1988) 6280",
        plane: Plane::XY,
        make: || boxed(Cellular::new(&CellularParams::default())),
        variants: &[("swaying", || {
            boxed(Cellular::new(&CellularParams { sway_um: 15.0, ..Default::default() }))
        })],
    },
    Entry {
        name: "double_gyre",
        formula: "u = -U sin(pi f) cos(pi Y), v = U cos(pi f) sin(pi Y) df/dX, f = e X^2 + (1 - 2e) X, e = eps sin wt",
        parameters: DoubleGyreParams::PARAMETERS,
        source: "Shadden, Lekien & Marsden, Physica D 212 (2005) 271",
        plane: Plane::XY,
        make: || boxed(DoubleGyre::new(&DoubleGyreParams::default())),
        variants: &[("steady", || {
            boxed(DoubleGyre::new(&DoubleGyreParams { epsilon: 0.0, ..Default::default() }))
        })],
    },
    Entry {
        name: "abc",
        formula: "u = (A sin kz + C cos ky, B sin kx + A cos kz, C sin ky + B cos kx)",
        parameters: AbcParams::PARAMETERS,
        source: "Dombre et al., J. Fluid Mech. 167 (1986) 353",
        plane: Plane::XY,
        make: || boxed(Abc::new(&AbcParams::default())),
        variants: &[("two", || {
            boxed(Abc::new(&AbcParams { amplitudes_um_s: [600.0, 500.0, 0.0], ..Default::default() }))
        })],
    },
    Entry {
        name: "hill",
        formula: "Hill's spherical vortex: u_rho = 3 U rho s/(2 a^2), u_s = 3 U (a^2 - 2 rho^2 - s^2)/(2 a^2) inside, a dipole flow outside",
        parameters: HillParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 7.2",
        plane: Plane::XY,
        make: || boxed(Hill::new(&HillParams::default())),
        variants: &[("moving", || {
            boxed(Hill::new(&HillParams { moving: true, axis: Axis::Z, ..Default::default() }))
        })],
    },
    Entry {
        name: "sinusoid",
        formula: "transverse u = A sin(ky + p); longitudinal A sin(kx + p); product A sin(kx + p) sin(ky + p)",
        parameters: SinusoidParams::PARAMETERS,
        source: "the usual test of the response of PIV to wavelength",
        plane: Plane::XY,
        make: || boxed(Sinusoid::new(&SinusoidParams::default())),
        variants: &[
            ("longitudinal", || {
                boxed(Sinusoid::new(&SinusoidParams {
                    variation: Variation::Longitudinal,
                    ..Default::default()
                }))
            }),
            ("product", || {
                boxed(Sinusoid::new(&SinusoidParams { variation: Variation::Product, ..Default::default() }))
            }),
        ],
    },
    Entry {
        name: "tanh_layer",
        formula: "u = Um + (dU/2) tanh(2 y / delta)",
        parameters: TanhLayerParams::PARAMETERS,
        source: "Michalke, J. Fluid Mech. 19 (1964) 543",
        plane: Plane::XY,
        make: || boxed(TanhLayer::new(&TanhLayerParams::default())),
        variants: &[],
    },
    Entry {
        name: "bickley_jet",
        formula: "u = U / cosh^2(y / L)",
        parameters: BickleyJetParams::PARAMETERS,
        source: "Drazin & Reid, Hydrodynamic Stability, 31",
        plane: Plane::XY,
        make: || boxed(BickleyJet::new(&BickleyJetParams::default())),
        variants: &[],
    },
    Entry {
        name: "source",
        formula: "u_r = U (c/r)^(n-1) outside the core, U r/c inside; n = 2 line, 3 point; hele_shaw: times 6 s (1 - s)",
        parameters: SourceParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 2.5",
        plane: Plane::XY,
        make: || boxed(Source::new(&SourceParams::default())),
        variants: &[
            ("sink", || boxed(Source::new(&SourceParams { core_speed_um_s: -1290.0, ..Default::default() }))),
            ("point", || {
                boxed(Source::new(&SourceParams {
                    shape: SourceShape::Point,
                    core_radius_um: 40.0,
                    ..Default::default()
                }))
            }),
            ("hele_shaw", || {
                boxed(Source::new(&SourceParams { shape: SourceShape::HeleShaw, ..Default::default() }))
            }),
        ],
    },
    Entry {
        name: "stokes_sphere",
        formula: "u = U - (3a/4) (U/r + x (U.x)/r^3) - (a^3/4) (U/r^3 - 3 x (U.x)/r^5)",
        parameters: StokesSphereParams::PARAMETERS,
        source: "Batchelor, An Introduction to Fluid Dynamics, 4.9",
        plane: Plane::XY,
        make: || boxed(StokesSphere::new(&StokesSphereParams::default())),
        variants: &[("oblique", || {
            boxed(StokesSphere::new(&StokesSphereParams {
                velocity_um_s: [900.0, -500.0, 300.0],
                ..Default::default()
            }))
        })],
    },
    Entry {
        name: "stokes_cylinder",
        formula: "psi = (A r + B/r + C r ln(r/a) + D r^3) sin theta between cylinder and cell, uniform beyond",
        parameters: StokesCylinderParams::PARAMETERS,
        source: "Happel & Brenner, Low Reynolds Number Hydrodynamics, 8-6",
        plane: Plane::XY,
        make: || boxed(StokesCylinder::new(&StokesCylinderParams::default())),
        variants: &[],
    },
    Entry {
        name: "toroidal_drop",
        formula: "psi = P (rho/R)^2 s z^2 (h0 s - z) / h0^3, s = 1 - rho^2/R^2",
        parameters: ToroidalDropParams::PARAMETERS,
        source: "a model made for this program",
        plane: Plane::XZ,
        make: || boxed(ToroidalDrop::new(&ToroidalDropParams::default())),
        variants: &[],
    },
    Entry {
        name: "coffee_ring",
        formula: "u_rho = 3 U (Z - Z^2/2), U = R^2/(4 rho (tf - t)) (s^-1/2 - s), Z = z/h, h = h0 (1 - t/tf) s",
        parameters: CoffeeRingParams::PARAMETERS,
        source: "Deegan et al., Phys. Rev. E 62 (2000) 756",
        plane: Plane::XZ,
        make: || boxed(CoffeeRing::new(&CoffeeRingParams::default())),
        variants: &[],
    },
    Entry {
        name: "rayleigh_streaming",
        formula: "u_y = F' S, u_z = -F S', F = b (z cosh Kz - h coth(Kh) sinh Kz), S = -sin(K (y + W/2))",
        parameters: RayleighStreamingParams::PARAMETERS,
        source: "Rayleigh, Phil. Trans. 175 (1884) 1; Muller et al., Phys. Rev. E 88 (2013) 023006",
        plane: Plane::YZ,
        make: || boxed(RayleighStreaming::new(&RayleighStreamingParams::default())),
        variants: &[("three half waves", || {
            boxed(RayleighStreaming::new(&RayleighStreamingParams { half_waves: 3, ..Default::default() }))
        })],
    },
    Entry {
        name: "acoustophoresis",
        formula: "u_y = v sin(2 k (y + W/2)), v = (2 Phi/3) k (d/2)^2 E / mu",
        parameters: AcoustophoresisParams::PARAMETERS,
        source: "Barnkob et al., Lab Chip 10 (2010) 563",
        plane: Plane::YZ,
        make: || boxed(Acoustophoresis::new(&AcoustophoresisParams::default())),
        variants: &[],
    },
    Entry {
        name: "kraichnan",
        formula: "u = SUM a_n cos(k_n.x + w_n t) + b_n sin(k_n.x + w_n t)",
        parameters: KraichnanParams::PARAMETERS,
        source: "Kraichnan, Phys. Fluids 13 (1970) 22",
        plane: Plane::XY,
        make: || boxed(Kraichnan::new(&KraichnanParams::default())),
        variants: &[
            ("plane", || boxed(Kraichnan::new(&KraichnanParams { dimensions: 2, ..Default::default() }))),
            ("unsteady periodic", || {
                boxed(Kraichnan::new(&KraichnanParams {
                    unsteadiness: 0.5,
                    period_um: [400.0, 400.0, 200.0],
                    modes: 60,
                    ..Default::default()
                }))
            }),
        ],
    },
    Entry {
        name: "gridded",
        formula: "u = SUM c_ijk B_i(x) B_j(y) B_k(z), cubic B-splines or linear, linear in time",
        parameters: &[
            Parameter::new(
                "interpolation",
                "Interpolation::Tricubic",
                "tricubic or trilinear",
                "How to fill the space between nodes.",
            ),
            Parameter::new(
                "periodic",
                "[false, false, false]",
                "true or false",
                "Whether the data repeat along x, y and z.",
            ),
            Parameter::new(
                "origin_um",
                "[-240.0, -120.0, -80.0]",
                "finite",
                "The first node of a .npy file, um.",
            ),
            Parameter::new(
                "spacing_um",
                "[10.0, 10.0, 10.0]",
                "> 0",
                "Distances of the nodes of a .npy file, um.",
            ),
            Parameter::new("times_s", "[]", "increasing", "Times of the layers of a .npy file, s."),
        ],
        source: "de Boor, A Practical Guide to Splines, IX and XIII",
        plane: Plane::XY,
        make: || grid(Interpolation::Tricubic),
        variants: &[("trilinear", || grid(Interpolation::Trilinear))],
    },
    Entry {
        name: "sum",
        formula: "u = SUM f_i(x, t)",
        parameters: &[],
        source: "composition",
        plane: Plane::XY,
        make: || boxed(Sum::new(vec![channel()?, vortex(0.0)?])),
        variants: &[
            ("one", || boxed(Sum::new(vec![vortex(1e3)?]))),
            ("three", || {
                boxed(Sum::new(vec![channel()?, vortex(1e3)?, boxed(Hill::new(&HillParams::default()))?]))
            }),
        ],
    },
    Entry {
        name: "scaled",
        formula: "u = a f(c + (x - c)/L, t)",
        parameters: ScaledParams::PARAMETERS,
        source: "composition",
        plane: Plane::XY,
        make: || {
            boxed(Scaled::new(
                vortex(0.0)?,
                &ScaledParams { velocity_factor: 0.5, length_factor: 1.5, centre_um: [10.0, 0.0, -30.0] },
            ))
        },
        variants: &[
            ("decaying", || {
                boxed(Scaled::new(
                    vortex(1e3)?,
                    &ScaledParams { velocity_factor: -0.5, ..Default::default() },
                ))
            }),
            ("alike", || {
                boxed(Scaled::new(
                    vortex(1e3)?,
                    &ScaledParams { velocity_factor: 0.5, length_factor: 0.5, ..Default::default() },
                ))
            }),
        ],
    },
    Entry {
        name: "translated",
        formula: "u = f(x - d, t)",
        parameters: TranslatedParams::PARAMETERS,
        source: "composition",
        plane: Plane::XY,
        make: || boxed(Translated::new(vortex(1e3)?, &TranslatedParams { offset_um: [60.0, -40.0, 5.0] })),
        variants: &[("moving hill", || {
            boxed(Translated::new(
                boxed(Hill::new(&HillParams { moving: true, ..Default::default() }))?,
                &TranslatedParams { offset_um: [60.0, -40.0, 5.0] },
            ))
        })],
    },
    Entry {
        name: "rotated",
        formula: "u = R f(c + R^T (x - c), t)",
        parameters: RotatedParams::PARAMETERS,
        source: "composition",
        plane: Plane::XY,
        make: || {
            boxed(Rotated::new(
                vortex(1e3)?,
                &RotatedParams { axis: [1.0, 2.0, 2.0], angle_rad: 0.7, centre_um: [0.0, 0.0, -30.0] },
            ))
        },
        variants: &[("gyre", || {
            boxed(Rotated::new(
                boxed(DoubleGyre::new(&DoubleGyreParams::default()))?,
                &RotatedParams { angle_rad: -1.1, ..Default::default() },
            ))
        })],
    },
    Entry {
        name: "moving",
        formula: "u = V + f(x - V t, t)",
        parameters: MovingParams::PARAMETERS,
        source: "composition",
        plane: Plane::XY,
        make: || boxed(Moving::new(vortex(1e3)?, &MovingParams { velocity_um_s: [300.0, -100.0, 50.0] })),
        variants: &[("cells", || {
            boxed(Moving::new(
                boxed(TaylorGreen::new(&TaylorGreenParams::default()))?,
                &MovingParams { velocity_um_s: [300.0, -100.0, 50.0] },
            ))
        })],
    },
    Entry {
        name: "modulated",
        formula: "u = (m + a cos(2 pi f t + p)) f(x, t)",
        parameters: ModulatedParams::PARAMETERS,
        source: "composition",
        plane: Plane::XY,
        make: || {
            boxed(Modulated::new(
                vortex(0.0)?,
                &ModulatedParams { mean: 0.3, amplitude: 0.7, frequency_hz: 30.0, phase_rad: 0.5 },
            ))
        },
        variants: &[("decaying", || {
            boxed(Modulated::new(
                vortex(1e3)?,
                &ModulatedParams { mean: 0.0, amplitude: 1.0, ..Default::default() },
            ))
        })],
    },
    Entry {
        name: "mirrored",
        formula: "u = M f(M x, t)",
        parameters: MirroredParams::PARAMETERS,
        source: "composition",
        plane: Plane::XY,
        make: || boxed(Mirrored::new(vortex(1e3)?, &MirroredParams { axis: Axis::X, at_um: 25.0 })),
        variants: &[("drop", || {
            boxed(Mirrored::new(
                boxed(ToroidalDrop::new(&ToroidalDropParams::default()))?,
                &MirroredParams { axis: Axis::Y, at_um: 10.0 },
            ))
        })],
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_everything_is_said() {
        for (i, entry) in ENTRIES.iter().enumerate() {
            assert!(ENTRIES[i + 1..].iter().all(|other| other.name != entry.name), "{}", entry.name);
            assert!(!entry.formula.is_empty() && !entry.source.is_empty(), "{}", entry.name);
            for parameter in entry.parameters {
                let said = [parameter.meaning(), parameter.range, parameter.default];
                assert!(said.iter().all(|text| !text.is_empty()), "{} {parameter:?}", entry.name);
            }
        }
        assert!(find("lamb_oseen").is_some() && find("lamb").is_none());
    }
}
