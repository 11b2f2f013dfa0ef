//! Tables 6.1 and 6.3 of Steinberger's thesis: the stages of a frame.
//!
//! The thesis clocked its stages. So does `isobar_octree::stages`, tile by tile on one thread, since the rays of a packet are in different stages at once; `octree/cpu`
//! itself has no clock in it and counts the work of each stage.

/// Degrees of the columns.
pub const DEGREES: [&str; 3] = ["tri-linear", "tri-square", "tri-cubic"];

/// Table 6.3 (a), milliseconds (paper-numbers: Steinberger2010, Tab6.3a): per data set five stages, per stage the three degrees. GeForce GTX 285 and Core i7,
/// 1024x768.
pub const PRINTED_6_3: [(&str, [[f64; 3]; 5]); 4] = [
    (
        "Bucky 32³",
        [
            [0.40, 0.39, 0.41],
            [21.96, 32.95, 40.47],
            [5.46, 21.92, 75.55],
            [0.62, 6.30, 22.29],
            [0.21, 2.32, 10.56],
        ],
    ),
    (
        "Dragon 128³",
        [
            [0.40, 0.40, 0.39],
            [54.06, 92.94, 114.9],
            [2.51, 11.88, 41.44],
            [0.67, 4.52, 21.58],
            [0.41, 2.90, 17.78],
        ],
    ),
    (
        "Foot 256³",
        [
            [0.40, 0.39, 0.40],
            [100.2, 205.0, 224.0],
            [3.85, 22.22, 67.16],
            [1.26, 6.73, 23.48],
            [0.71, 4.34, 22.58],
        ],
    ),
    (
        "Vertebra 512³",
        [
            [0.42, 0.42, 0.42],
            [98.64, 173.6, 214.1],
            [4.33, 20.11, 64.23],
            [0.77, 4.53, 17.24],
            [0.37, 2.50, 15.74],
        ],
    ),
];

/// Stages of [`PRINTED_6_3`].
pub const STAGES: [&str; 5] = ["setup", "traverse", "composition + load", "rootfind", "normal calc + store"];

/// Shares of composition and of root finding in Table 6.1, percent of a frame (paper-numbers: Steinberger2010, Tab6.1): one algebraic surface.
pub const PRINTED_6_1: [[f64; 2]; 3] = [[3.941, 71.017], [1.823, 93.551], [1.029, 97.489]];

/// The composition that stands for the thesis's in Table 6.1, and the root finder with its budget 6 (d + 1) for d = 3.
pub const KERNELS_6_1: (&str, &str, u32) = ("PF", "LR81", 24);

#[cfg(test)]
mod tests {
    use super::*;

    /// The relative half of Table 6.3 follows from the absolute one: the copies hold together.
    #[test]
    fn shares_follow_from_the_times() {
        // Table 6.3 (b): traversal, percent.
        let printed = [
            [76.65, 51.58, 27.11],
            [93.11, 82.51, 58.61],
            [94.16, 85.89, 66.35],
            [94.37, 86.31, 68.69],
        ];
        for ((name, stages), shares) in PRINTED_6_3.iter().zip(printed) {
            for (degree, share) in shares.iter().enumerate() {
                let whole: f64 = stages.iter().map(|s| s[degree]).sum();
                let found = 100.0 * stages[1][degree] / whole;
                assert!((found - share).abs() < 0.06, "{name} {}: {found}", DEGREES[degree]);
            }
        }
    }
}
