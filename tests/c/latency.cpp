// How long one answer takes by size of cloud: the library beside PCL's SHOTCOLOR and PFHRGB, on one thread.
//
//     latency ARTEFACT POINTS...
//
// The cloud is the visible half of a cylinder, 8 cm wide and 12 cm high, 60 cm from the camera, with 0.5 mm of noise and a
// pattern of colours, in ever more points. The library describes it and finds the nearest objects. PCL's part is what is
// needed before matching: keypoints on a grid of 2 cm, normals within 1 cm of cloud and keypoints, and a histogram of each
// keypoint within 5 cm. Runs of the three follow each other in turn. A method that has taken a minute is not run again at
// this size; one that would take more than ten by the square of the points, as all pairs do, is not run at all. Prints
// medians of processor time, and how many runs they are of, as rows of a table in Markdown.
#include <descry_recognise.h>

#include <pcl/features/normal_3d.h>
#include <pcl/features/pfhrgb.h>
#include <pcl/features/shot.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <random>
#include <vector>

using Point = pcl::PointXYZRGB;
using Cloud = pcl::PointCloud<Point>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Tree = pcl::search::KdTree<Point>;

struct Arrays {
    std::vector<float> xyz;
    std::vector<std::uint8_t> rgb;
    Cloud::Ptr cloud{new Cloud};
};

static Arrays cylinder(std::size_t points) {
    std::mt19937 random(1);
    // The standard fixes the engine's numbers, but not those of its distributions.
    const auto uniform = [&] { return static_cast<double>(random()) / 4294967296.0; };
    Arrays arrays;
    for (std::size_t i = 0; i < points; ++i) {
        const double angle = M_PI * uniform(), height = 0.12 * uniform(), radius = 0.04 + 0.0005 * (2 * uniform() - 1);
        const bool is_dark = (static_cast<int>(angle * 8 / M_PI) + static_cast<int>(height / 0.02)) % 2 == 0;
        Point point;
        point.x = static_cast<float>(radius * std::cos(angle));
        point.y = static_cast<float>(height - 0.06);
        point.z = static_cast<float>(0.6 - radius * std::sin(angle));
        const int noise = static_cast<int>(16 * uniform());
        point.r = static_cast<std::uint8_t>((is_dark ? 40 : 200) + noise);
        point.g = static_cast<std::uint8_t>((is_dark ? 70 : 180) + noise);
        point.b = static_cast<std::uint8_t>((is_dark ? 160 : 60) + noise);
        arrays.cloud->push_back(point);
        arrays.xyz.insert(arrays.xyz.end(), {point.x, point.y, point.z});
        arrays.rgb.insert(arrays.rgb.end(), {point.r, point.g, point.b});
    }
    return arrays;
}

static std::size_t recognise(const descry_recogniser *recogniser, const Arrays &arrays) {
    descry_answer *answer;
    const descry_status status = descry_recogniser_recognise(recogniser, arrays.xyz.data(), arrays.rgb.data(),
                                                             arrays.xyz.size() / 3, nullptr, 3, &answer);
    if (status != DESCRY_OK) {
        std::fprintf(stderr, "%s\n", descry_error_what());
        std::exit(1);
    }
    const std::size_t count = answer->count;
    descry_answer_free(answer);
    return count;
}

// Histograms of keypoints by one of PCL's descriptors; how many there are.
template <typename Estimation, typename Signature>
static std::size_t histograms(const Cloud::Ptr &cloud) {
    Cloud::Ptr keypoints(new Cloud), kept(new Cloud);
    pcl::VoxelGrid<Point> grid;
    grid.setInputCloud(cloud);
    grid.setLeafSize(0.02f, 0.02f, 0.02f);
    grid.filter(*keypoints);
    Tree::Ptr tree(new Tree);
    Normals::Ptr normals(new Normals), kept_normals(new Normals), of_keypoints(new Normals);
    pcl::NormalEstimation<Point, pcl::Normal> of_cloud;
    of_cloud.setInputCloud(cloud);
    of_cloud.setSearchMethod(tree);
    of_cloud.setRadiusSearch(0.01);
    of_cloud.compute(*normals);
    of_cloud.setInputCloud(keypoints);
    of_cloud.setSearchSurface(cloud);
    of_cloud.compute(*of_keypoints);
    for (std::size_t i = 0; i < cloud->size(); ++i)
        if (std::isfinite((*normals)[i].normal_x)) {
            kept->push_back((*cloud)[i]);
            kept_normals->push_back((*normals)[i]);
        }
    Estimation estimation;
    estimation.setInputCloud(keypoints);
    estimation.setSearchSurface(kept);
    estimation.setInputNormals(kept_normals);
    estimation.setSearchMethod(Tree::Ptr(new Tree));
    estimation.setRadiusSearch(0.05);
    pcl::PointCloud<Signature> found;
    estimation.compute(found);
    return found.size();
}

// Of the processor: of this one thread, whatever else the machine does.
static double seconds(const std::function<std::size_t()> &run) {
    const std::clock_t begun = std::clock();
    if (run() == 0) std::exit(1);
    return static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC;
}

int main(int argc, char **argv) {
    if (argc < 3) return 2;
    descry_recogniser *recogniser;
    if (descry_recogniser_open(argv[1], &recogniser) != DESCRY_OK) {
        std::fprintf(stderr, "%s\n", descry_error_what());
        return 1;
    }
    double before[3] = {0, 0, 0}, points_before = 1;
    for (int at = 2; at < argc; ++at) {
        const Arrays arrays = cylinder(std::strtoul(argv[at], nullptr, 10));
        const double growth = static_cast<double>(arrays.cloud->size()) / points_before;
        points_before = static_cast<double>(arrays.cloud->size());
        const std::function<std::size_t()> methods[3] = {
            [&] { return recognise(recogniser, arrays); },
            [&] {
                return histograms<pcl::SHOTColorEstimation<Point, pcl::Normal, pcl::SHOT1344>, pcl::SHOT1344>(
                    arrays.cloud);
            },
            [&] {
                using Signature = pcl::PFHRGBSignature250;
                return histograms<pcl::PFHRGBEstimation<Point, pcl::Normal, Signature>, Signature>(arrays.cloud);
            },
        };
        std::vector<double> times[3];
        double spent[3] = {0, 0, 0};
        for (int run = 0; run < 21; ++run)
            for (int method = 0; method < 3; ++method)
                if (spent[method] < 60 && before[method] * growth * growth < 600) {
                    times[method].push_back(seconds(methods[method]));
                    spent[method] += times[method].back();
                }
        std::printf("| %zu |", arrays.cloud->size());
        for (int method = 0; method < 3; ++method) {
            if (times[method].empty()) {
                before[method] *= growth * growth;
                std::printf(" more than 10 min, not run |");
                continue;
            }
            std::sort(times[method].begin(), times[method].end());
            const double median = times[method][times[method].size() / 2];
            before[method] = median;
            std::printf(" %.3g ms (%zu) |", 1e3 * median, times[method].size());
        }
        std::printf("\n");
        std::fflush(stdout);
    }
    descry_recogniser_free(recogniser);
}
