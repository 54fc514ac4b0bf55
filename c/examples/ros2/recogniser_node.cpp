// A ROS 2 node that names the object in each cloud of a topic. UNTESTED: it is written against the documentation of
// rclcpp, sensor_msgs and vision_msgs (Humble), and has been neither compiled nor run.
//
//     ros2 run descry_recogniser recogniser_node --ros-args -p artefact:=objects -r cloud:=/segmented/points
//
// Subscribes `cloud` (sensor_msgs/PointCloud2): one segmented object, with fields x, y, z (float32) and rgb, in metres, in
// the frame of the camera. Publishes `object` (vision_msgs/Classification): the nearest objects, nearest first; their
// score is the negative distance. Nothing is published of an unknown object.
#include <descry_recognise.h>

#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <sensor_msgs/point_cloud2_iterator.hpp>
#include <vision_msgs/msg/classification.hpp>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

class RecogniserNode : public rclcpp::Node {
public:
    RecogniserNode() : Node("descry_recogniser") {
        const std::string artefact = declare_parameter<std::string>("artefact", "objects");
        most_ = static_cast<std::size_t>(std::max<std::int64_t>(1, declare_parameter<std::int64_t>("most", 3)));
        descry_recogniser *opened = nullptr;
        if (descry_recogniser_open(artefact.c_str(), &opened) != DESCRY_OK)
            throw std::runtime_error(std::string(descry_error_what()) + "\n" + descry_error_advice());
        recogniser_.reset(opened);
        publisher_ = create_publisher<vision_msgs::msg::Classification>("object", 10);
        subscription_ = create_subscription<sensor_msgs::msg::PointCloud2>(
            "cloud", rclcpp::SensorDataQoS(),
            [this](sensor_msgs::msg::PointCloud2::ConstSharedPtr cloud) { recognise(*cloud); });
    }

private:
    struct Free {
        void operator()(descry_recogniser *recogniser) const { descry_recogniser_free(recogniser); }
        void operator()(descry_answer *answer) const { descry_answer_free(answer); }
    };

    using Points = sensor_msgs::msg::PointCloud2;

    static bool has_field(const Points &cloud, const std::string &name) {
        const auto is_it = [&](const auto &field) { return field.name == name; };
        return std::any_of(cloud.fields.begin(), cloud.fields.end(), is_it);
    }

    void recognise(const Points &cloud) {
        if (!has_field(cloud, "x") || !has_field(cloud, "y") || !has_field(cloud, "z")) {
            RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 5000, "cloud: no fields x, y and z");
            return;
        }
        // The iterators go from point to point as if rows had no padding behind them.
        if (cloud.height > 1 && cloud.row_step != cloud.point_step * cloud.width) {
            RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 5000, "cloud: rows must have no padding");
            return;
        }
        const std::size_t points = static_cast<std::size_t>(cloud.width) * cloud.height;
        std::vector<float> xyz;
        xyz.reserve(3 * points);
        sensor_msgs::PointCloud2ConstIterator<float> x(cloud, "x"), y(cloud, "y"), z(cloud, "z");
        for (; x != x.end(); ++x, ++y, ++z) xyz.insert(xyz.end(), {*x, *y, *z});
        std::vector<std::uint8_t> rgb;
        if (has_field(cloud, "rgb")) {
            rgb.reserve(3 * points);
            sensor_msgs::PointCloud2ConstIterator<std::uint8_t> r(cloud, "r"), g(cloud, "g"), b(cloud, "b");
            for (; r != r.end(); ++r, ++g, ++b) rgb.insert(rgb.end(), {*r, *g, *b});
        }
        descry_answer *made = nullptr;
        const descry_status status = descry_recogniser_recognise(
            recogniser_.get(), xyz.data(), rgb.empty() ? nullptr : rgb.data(), xyz.size() / 3, nullptr, most_, &made);
        const std::unique_ptr<descry_answer, Free> answer(made);
        if (status != DESCRY_OK) {
            RCLCPP_WARN_THROTTLE(get_logger(), *get_clock(), 5000, "%s: %s", descry_status_name(status),
                                 descry_error_what());
            return;
        }
        if (answer->unknown) return;
        vision_msgs::msg::Classification message;
        message.header = cloud.header;
        for (std::size_t i = 0; i < answer->count; ++i) {
            vision_msgs::msg::ObjectHypothesis hypothesis;
            hypothesis.class_id = answer->ranking[i].instance;
            hypothesis.score = -answer->ranking[i].distance;
            message.results.push_back(hypothesis);
        }
        publisher_->publish(message);
    }

    std::size_t most_ = 1;
    std::unique_ptr<descry_recogniser, Free> recogniser_;
    rclcpp::Publisher<vision_msgs::msg::Classification>::SharedPtr publisher_;
    rclcpp::Subscription<sensor_msgs::msg::PointCloud2>::SharedPtr subscription_;
};

int main(int argc, char **argv) {
    rclcpp::init(argc, argv);
    try {
        rclcpp::spin(std::make_shared<RecogniserNode>());
    } catch (const std::exception &error) {
        RCLCPP_FATAL(rclcpp::get_logger("descry_recogniser"), "%s", error.what());
        rclcpp::shutdown();
        return 1;
    }
    rclcpp::shutdown();
    return 0;
}
