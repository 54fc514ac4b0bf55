// Names the objects in clouds of PCL: the arrays that the library takes, made of a pcl::PointCloud.
//
//     g++ -std=c++17 recognise_pcl.cpp $(pkg-config --cflags --libs descry_recognise pcl_io) -o recognise_pcl
//     ./recognise_pcl ARTEFACT CLOUD.pcd...
#include <descry_recognise.h>

#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>

#include <cstdint>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

using Cloud = pcl::PointCloud<pcl::PointXYZRGB>;

// A failure as an exception, with what to do.
struct DescryError : std::runtime_error {
    descry_status status;
    explicit DescryError(descry_status status)
        : std::runtime_error(std::string(descry_error_what()) + "\n" + descry_error_advice()), status(status) {}
};

struct FreeRecogniser {
    void operator()(descry_recogniser *recogniser) const { descry_recogniser_free(recogniser); }
};
struct FreeAnswer {
    void operator()(descry_answer *answer) const { descry_answer_free(answer); }
};
using Recogniser = std::unique_ptr<descry_recogniser, FreeRecogniser>;
using Answer = std::unique_ptr<descry_answer, FreeAnswer>;

Recogniser open(const char *artefact) {
    descry_recogniser *recogniser;
    if (const descry_status status = descry_recogniser_open(artefact, &recogniser)) throw DescryError(status);
    return Recogniser(recogniser);
}

Answer recognise(const descry_recogniser *recogniser, const Cloud &cloud, std::size_t most) {
    // PCL pads points to 32 bytes; the library takes coordinates and colours without gaps.
    std::vector<float> xyz;
    std::vector<std::uint8_t> rgb;
    xyz.reserve(3 * cloud.size());
    rgb.reserve(3 * cloud.size());
    for (const auto &point : cloud) {
        xyz.insert(xyz.end(), {point.x, point.y, point.z});
        rgb.insert(rgb.end(), {point.r, point.g, point.b});
    }
    const Eigen::Vector4f &origin = cloud.sensor_origin_;
    const float viewpoint[3] = {origin.x(), origin.y(), origin.z()};
    descry_answer *answer;
    const descry_status status =
        descry_recogniser_recognise(recogniser, xyz.data(), rgb.data(), cloud.size(), viewpoint, most, &answer);
    if (status) throw DescryError(status);
    return Answer(answer);
}

int main(int argc, char **argv) try {
    if (argc < 3) {
        std::fprintf(stderr, "usage: %s ARTEFACT CLOUD.pcd...\n", argv[0]);
        return 2;
    }
    const Recogniser recogniser = open(argv[1]);
    for (int i = 2; i < argc; ++i) {
        Cloud cloud;
        if (pcl::io::loadPCDFile(argv[i], cloud) < 0) return 1;
        const Answer answer = recognise(recogniser.get(), cloud, 1);
        const descry_named &nearest = answer->ranking[0];
        std::printf("%s: %s%s (%s), distance %.17g\n", argv[i], answer->unknown ? "unknown, most like " : "",
                    nearest.instance, nearest.category, nearest.distance);
    }
} catch (const std::exception &error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
