// Runs a tree in BehaviorTree.CPP with scripted leaves and prints what happens in each tick.
//
//     g++ -std=c++17 -O1 -I BT/include benchmarks/import_original.cpp BT/build/libbehaviortree_cpp.a ... -o original
//     original TREE.xml LEAVES.txt SEED TICKS
//
// LEAVES.txt: "leaf NAME PORT ..." for every node that the tree does not explain, "set KEY VALUE" for every value that
// the surrounding program would give, "main ID" for the tree that runs. Start number k of a leaf takes as long and ends
// as hash(SEED/NAME/k) says.

#include <cstdint>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>

#include "behaviortree_cpp/bt_factory.h"

namespace
{
std::string seed;
std::string events;
std::map<std::string, int> starts;

uint32_t hash(const std::string& text)
{
  uint32_t found = 2166136261u;
  for(const unsigned char c : text)
  {
    found = (found ^ c) * 16777619u;
  }
  return found ^ (found >> 15);
}

class Leaf : public BT::StatefulActionNode
{
public:
  using BT::StatefulActionNode::StatefulActionNode;

  BT::NodeStatus onStart() override
  {
    const std::string& name = registrationName();
    job_ = hash(seed + "/" + name + "/" + std::to_string(++starts[name]));
    left_ = job_ % 3;
    events += " start:" + name;
    return onRunning();
  }

  BT::NodeStatus onRunning() override
  {
    if(left_-- > 0)
    {
      return BT::NodeStatus::RUNNING;
    }
    const bool success = (job_ >> 4) % 8 < 5;
    events += std::string(success ? " success:" : " failure:") + registrationName();
    return success ? BT::NodeStatus::SUCCESS : BT::NodeStatus::FAILURE;
  }

  void onHalted() override
  {
    events += " halt:" + registrationName();
  }

private:
  uint32_t job_ = 0;
  int left_ = 0;
};
}  // namespace

int main(int, char** argv)
{
  seed = argv[3];
  const int ticks = std::stoi(argv[4]);
  BT::BehaviorTreeFactory factory;
  auto board = BT::Blackboard::create();
  std::string main_tree;
  std::ifstream leaves(argv[2]);
  for(std::string line; std::getline(leaves, line);)
  {
    std::istringstream words(line);
    std::string kind, name, word;
    words >> kind >> name;
    if(kind == "main")
    {
      main_tree = name;
      continue;
    }
    if(kind == "set")
    {
      int value = 0;
      words >> value;
      board->set(name, value);
      continue;
    }
    BT::PortsList ports;
    while(words >> word)
    {
      ports.insert(BT::InputPort<BT::AnyTypeAllowed>(word));
    }
    factory.registerNodeType<Leaf>(name, ports);
  }
  try
  {
    std::streambuf* out = std::cout.rdbuf(nullptr);  // warnings of the library
    factory.registerBehaviorTreeFromFile(argv[1]);
    auto tree = factory.createTree(main_tree, board);
    std::cout.rdbuf(out);
    auto status = BT::NodeStatus::RUNNING;
    for(int tick = 0; tick < ticks && status == BT::NodeStatus::RUNNING; ++tick)
    {
      events.clear();
      status = tree.tickExactlyOnce();
      std::cout << BT::toStr(status) << events << "\n";
    }
    events.clear();
    tree.haltTree();
    std::cout << "halted" << events << "\n";
  }
  catch(const std::exception& error)
  {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
