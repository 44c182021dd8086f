//! Constants of the elementary functions, for each precision.
//!
//! The polynomials are minimax approximations. Those for f64 are from Sun's fdlibm (Ng, 1993). Those for f32 are from Cephes (Moshier,
//! 1989) and FreeBSD's msun (Cox, Gladman). Each list begins with the constant term. It does not contain the leading terms, which
//! [`crate::elementary`] adds.
#![allow(clippy::excessive_precision, clippy::approx_constant, reason = "as published; the nearest number is meant")]

/// Constants of one precision. The trait is public in a private module, which seals [`Scalar`](crate::Scalar).
pub trait Coefficients: Sized + 'static {
    /// Number pi/2 as a sum of pieces. The products of all pieces but the last with an integer k of the allowed range are exact.
    const HALF_PI_PIECES: &'static [Self];
    /// Upper bound of |x - k pi/2| after argument reduction: pi/4, and a margin for the rounding of k.
    const REDUCED_MAX: Self;
    /// Upper bound of the rounding error that argument reduction returns as the low part.
    const REDUCED_LOW_MAX: Self;
    /// Polynomial in x^2 that approximates (sin x - x) / x^3.
    const SIN: &'static [Self];
    /// Polynomial in x^2 that approximates (cos x - 1 + x^2/2) / x^4.
    const COS: &'static [Self];

    /// Argument below which exp is 0.
    const EXP_MIN: Self;
    /// Argument at and above which exp is infinite.
    const EXP_MAX: Self;
    /// Number ln 2 as a sum of two pieces. The product of the first one with every exponent is exact.
    const LN_2: [Self; 2];
    /// Polynomial in x^2 that approximates (x coth(x/2) - 2) / x^2.
    const EXP: &'static [Self];
    /// Polynomial in s^2 that approximates (ln((1 + s) / (1 - s)) - 2 s) / s^3.
    const LN: &'static [Self];

    /// Magnitude above which atan2 scales its arguments down, because sums may overflow.
    const HUGE: Self;
    /// Number pi as a sum of the nearest number and its rounding error.
    const PI: [Self; 2];
    /// Number pi/2 as a sum of the nearest number and its rounding error.
    const HALF_PI: [Self; 2];
    /// Number pi/4 as a sum of the nearest number and its rounding error.
    const QUARTER_PI: [Self; 2];
    /// Number atan(1/2) as a sum of the nearest number and its rounding error.
    const ATAN_HALF: [Self; 2];
    /// Polynomial in x^2 that approximates (x - atan x) / x^3.
    const ATAN: &'static [Self];

    /// Numerator, a polynomial in x^2, of a rational approximation of (asin x - x) / x^3.
    const ASIN_NUMERATOR: &'static [Self];
    /// Denominator, a polynomial in x^2, of a rational approximation of (asin x - x) / x^3.
    const ASIN_DENOMINATOR: &'static [Self];
    /// Factor 2^s + 1, which splits a number into halves of at most s bits, whose products are exact (Veltkamp).
    const SPLITTER: Self;
}

impl Coefficients for f64 {
    // Three pieces of 33 bits: exact for |k| < 2^20.
    const HALF_PI_PIECES: &'static [f64] = &[1.5707963267341256, 6.077100506303966e-11, 2.0222662487111665e-21, 8.4784276603689e-32];
    const REDUCED_MAX: f64 = 0.786;
    const REDUCED_LOW_MAX: f64 = 1e-15;
    const SIN: &'static [f64] = &[
        -1.66666666666666324348e-01,
        8.33333333332248946124e-03,
        -1.98412698298579493134e-04,
        2.75573137070700676789e-06,
        -2.50507602534068634195e-08,
        1.58969099521155010221e-10,
    ];
    const COS: &'static [f64] = &[
        4.16666666666666019037e-02,
        -1.38888888888741095749e-03,
        2.48015872894767294178e-05,
        -2.75573143513906633035e-07,
        2.08757232129817482790e-09,
        -1.13596475577881948265e-11,
    ];

    const EXP_MIN: f64 = -746.0;
    const EXP_MAX: f64 = 710.0;
    // 42 bits: exact for |k| < 2^11.
    const LN_2: [f64; 2] = [0.6931471805598903, 5.497923018708371e-14];
    const EXP: &'static [f64] = &[
        1.66666666666666019037e-01,
        -2.77777777770155933842e-03,
        6.61375632143793436117e-05,
        -1.65339022054652515390e-06,
        4.13813679705723846039e-08,
    ];
    const LN: &'static [f64] = &[
        6.666666666666735130e-01,
        3.999999999940941908e-01,
        2.857142874366239149e-01,
        2.222219843214978396e-01,
        1.818357216161805012e-01,
        1.531383769920937332e-01,
        1.479819860511658591e-01,
    ];

    const HUGE: f64 = 1e300;
    const PI: [f64; 2] = [3.141592653589793, 1.2246467991473532e-16];
    const HALF_PI: [f64; 2] = [1.5707963267948966, 6.123233995736766e-17];
    const QUARTER_PI: [f64; 2] = [0.7853981633974483, 3.061616997868383e-17];
    const ATAN_HALF: [f64; 2] = [0.4636476090008061, 2.2698777452961687e-17];
    const ATAN: &'static [f64] = &[
        3.33333333333329318027e-01,
        -1.99999999998764832476e-01,
        1.42857142725034663711e-01,
        -1.11111104054623557880e-01,
        9.09088713343650656196e-02,
        -7.69187620504482999495e-02,
        6.66107313738753120669e-02,
        -5.83357013379057348645e-02,
        4.97687799461593236017e-02,
        -3.65315727442169155270e-02,
        1.62858201153657823623e-02,
    ];

    const ASIN_NUMERATOR: &'static [f64] = &[
        1.66666666666666657415e-01,
        -3.25565818622400915405e-01,
        2.01212532134862925881e-01,
        -4.00555345006794114027e-02,
        7.91534994289814532176e-04,
        3.47933107596021167570e-05,
    ];
    const ASIN_DENOMINATOR: &'static [f64] =
        &[1.0, -2.40339491173441421878e+00, 2.02094576023350569471e+00, -6.88283971605453293030e-01, 7.70381505559019352791e-02];
    const SPLITTER: f64 = 134217729.0;
}

impl Coefficients for f32 {
    // Four pieces of 11 bits: exact for |k| < 2^13.
    const HALF_PI_PIECES: &'static [f32] =
        &[1.5703125, 0.0004837512969970703, 7.549533620476723e-08, 2.5632829192545614e-12, 6.123234262925839e-17];
    const REDUCED_MAX: f32 = 0.787;
    const REDUCED_LOW_MAX: f32 = 1e-6;
    const SIN: &'static [f32] = &[-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4];
    const COS: &'static [f32] = &[4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5];

    const EXP_MIN: f32 = -104.0;
    const EXP_MAX: f32 = 89.0;
    // 16 bits: exact for |k| < 2^8.
    const LN_2: [f32; 2] = [0.693145751953125, 1.428606765330187e-06];
    const EXP: &'static [f32] = &[1.6666625440e-1, -2.7667332906e-3];
    const LN: &'static [f32] = &[0.66666662693, 0.40000972152, 0.28498786688, 0.24279078841];

    const HUGE: f32 = 1e37;
    const PI: [f32; 2] = [3.1415927410125732, -8.742277657347586e-08];
    const HALF_PI: [f32; 2] = [1.5707963705062866, -4.371138828673793e-08];
    const QUARTER_PI: [f32; 2] = [0.7853981852531433, -2.1855694143368964e-08];
    const ATAN_HALF: [f32; 2] = [0.46364760398864746, 5.01215868808913e-09];
    const ATAN: &'static [f32] = &[3.3333328366e-01, -1.9999158382e-01, 1.4253635705e-01, -1.0648017377e-01, 6.1687607318e-02];

    const ASIN_NUMERATOR: &'static [f32] = &[1.6666586697e-01, -4.2743422091e-02, -8.6563630030e-03];
    const ASIN_DENOMINATOR: &'static [f32] = &[1.0, -7.0662963390e-01];
    const SPLITTER: f32 = 4097.0;
}
